"""Which scenarios a run of the benchmark drives, over blocks of seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import msgspec

from agribot.app.workers import results
from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.job import Job
from agribot.lab.bench.nav.judge import Outcome
from agribot.lab.bench.nav.kept import KeptMissions
from agribot.lab.bench.nav.missions import run_missions
from agribot.lab.bench.nav.original import run_original
from agribot.lab.bench.nav.scenario import Receiver, Scenario, Variant, scenario
from agribot.lab.bench.nav.stack_missions import run_stack_missions
from agribot.lab.bench.nav.table import Line, line

# So many robots share one set of arrays: each costs a third of what it does among the least. More
# save little and come back late.
MOST_IN_BLOCK, LEAST_IN_BLOCK = 1000, 125
# Robots of the stack share nothing but the plant, which is cheap.
STACK_BLOCK = 5
Stop = Callable[[], bool]


# What `agribot bench nav` drives when nothing is chosen: the published table.
PUBLISHED: tuple[tuple[Receiver, bool, Variant], ...] = (
    ("m8n", True, "nominal"),
    ("rtk", False, "nominal"),
    ("rtk", True, "nominal"),
    ("rtk-dual", True, "nominal"),
    ("hector", True, "nominal"),
    ("legacy", True, "nominal"),
    ("m8n", True, "hard"),
    ("hector", True, "hard"),
    ("rtk", True, "hard"),
)
ORIGINAL: tuple[Receiver, ...] = ("hector", "m8n", "rtk")
# It hardly ever finishes, so each of its missions takes the full half hour.
MAX_ORIGINALS = 100


def plan_published(
    seeds: Sequence[int], robot: RobotSpec, speed_mps: float, *, baseline: bool
) -> list[Job]:
    jobs = [
        chosen(
            seeds, robot, scenario(receiver, vision=vision, speed_mps=speed_mps, variant=variant)
        )
        for receiver, vision, variant in PUBLISHED
    ]
    if baseline:
        jobs += originals(seeds[:MAX_ORIGINALS], robot, ORIGINAL, "nominal")
    return jobs


def chosen(seeds: Sequence[int], robot: RobotSpec, what: Scenario) -> Job:
    return Job(scenario=what, seeds=tuple(seeds), robot=robot)


def originals(
    seeds: Sequence[int], robot: RobotSpec, receivers: Sequence[Receiver], variant: Variant
) -> list[Job]:
    return [
        Job(
            scenario=scenario(receiver, vision=False, speed_mps=0.4, variant=variant),
            seeds=tuple(seeds),
            robot=robot,
            is_original=True,
        )
        for receiver in receivers
    ]


def drive(job: Job, stop: Stop) -> tuple[Job, list[Outcome]]:
    if job.is_original:
        return job, run_original(job.seeds, job.scenario, job.robot, stop)
    run = run_stack_missions if job.scenario.is_of_stack else run_missions
    return job, run(job.seeds, job.scenario, job.robot, stop, has_level=job.has_level)


def drive_all(
    jobs: Sequence[Job],
    workers: int,
    stop: Stop,
    done: Callable[[Sequence[int]], None],
    kept: KeptMissions | None = None,
) -> Iterator[tuple[Line, list[Outcome]]]:
    """One line per job, in their order, once all its seeds are driven; none after a stop.

    `done` hears the seeds of every block, also of those that `kept` has from before.
    """
    collected: dict[str, list[Outcome]] = {}
    blocks: list[Job] = []
    for job in jobs:
        found = {} if kept is None else kept.find(job)
        collected[job.name] = [found[seed] for seed in job.seeds if seed in found]
        done([outcome.seed for outcome in collected[job.name]])
        blocks += _split(job, [seed for seed in job.seeds if seed not in found], workers)
    for block, outcomes in results(drive, blocks, workers, stop):
        if not stop():
            collected[block.name] += outcomes
            if kept is not None:
                kept.add(block, outcomes)
            done(block.seeds)
    for job in jobs:
        outcomes = sorted(collected[job.name], key=lambda outcome: outcome.seed)
        if len(outcomes) == len(job.seeds):
            yield line(job.name, outcomes), outcomes


def _split(job: Job, seeds: Sequence[int], workers: int) -> list[Job]:
    """Split seeds into blocks, one at least for each worker if there are enough of them."""
    most, least = (STACK_BLOCK, 1) if job.scenario.is_of_stack else (MOST_IN_BLOCK, LEAST_IN_BLOCK)
    each = min(most, max(least, -(-len(seeds) // workers)))
    return [
        msgspec.structs.replace(job, seeds=tuple(seeds[first : first + each]))
        for first in range(0, len(seeds), each)
    ]
