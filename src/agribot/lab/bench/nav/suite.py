"""Which scenarios a run of the benchmark drives, and where: in processes or on a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import msgspec

from agribot.app.workers import results
from agribot.core.errors import AgribotError
from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.job import Job
from agribot.lab.bench.nav.judge import Outcome
from agribot.lab.bench.nav.kept import KeptMissions
from agribot.lab.bench.nav.missions import Stop, run_mission
from agribot.lab.bench.nav.original import run_original
from agribot.lab.bench.nav.scenario import Scenario, Variant, make_scenario
from agribot.lab.bench.nav.table import Line, line
from agribot.lab.sweep.ray_cluster import RayCluster

Executor = Callable[[Sequence[Job], Stop], Iterator[tuple[Job, Outcome]]]

# Scenarios of `agribot bench nav` by default: the published table.
PUBLISHED: tuple[tuple[str, bool, Variant], ...] = (
    ("ideal", False, "nominal"),
    ("rtk", False, "nominal"),
    ("rtk", True, "nominal"),
    ("rtk-dual", True, "nominal"),
    ("rtk-1", False, "nominal"),
    ("rtk-trees", True, "nominal"),
    ("rtk-trees", False, "nominal"),
    ("m8n", True, "nominal"),
    ("m8n-1", True, "nominal"),
    ("m8n-urban", True, "nominal"),
    ("legacy", True, "nominal"),
    ("seed", True, "nominal"),
    ("rtk", True, "hard"),
    ("m8n", True, "hard"),
    ("seed", True, "hard"),
)
ORIGINAL = ("seed", "m8n", "rtk")
ORIGINAL_MPS = 0.4
# Largest number of the original's missions: it hardly ever finishes, so each takes the full half
# hour.
MAX_ORIGINALS = 100


def plan_published(
    seeds: Sequence[int], robot: RobotSpec, speed_mps: float, *, baseline: bool
) -> list[Job]:
    jobs = [
        choose(
            seeds, robot, make_scenario(sensors, vision=seen, speed_mps=speed_mps, variant=variant)
        )
        for sensors, seen, variant in PUBLISHED
    ]
    if baseline:
        jobs += plan_originals(seeds[:MAX_ORIGINALS], robot, ORIGINAL, "nominal")
    return jobs


def choose(seeds: Sequence[int], robot: RobotSpec, what: Scenario) -> Job:
    return Job(scenario=what, seeds=tuple(seeds), robot=robot)


def plan_originals(
    seeds: Sequence[int], robot: RobotSpec, presets: Sequence[str], variant: Variant
) -> list[Job]:
    scenarios = [
        make_scenario(sensors, vision=False, speed_mps=ORIGINAL_MPS, variant=variant)
        for sensors in presets
    ]
    return [
        Job(scenario=what, seeds=tuple(seeds), robot=robot, is_original=True) for what in scenarios
    ]


def drive(job: Job, stop: Stop = lambda: False) -> tuple[Job, Outcome]:
    """Drive the mission of a job of one seed."""
    run = run_original if job.is_original else run_mission
    return job, run(job.seeds[0], job.scenario, job.robot, stop)


def use_processes(workers: int) -> Executor:
    """Drive in processes of this machine; one worker is this process itself."""

    def execute(jobs: Sequence[Job], stop: Stop) -> Iterator[tuple[Job, Outcome]]:
        return results(drive, jobs, workers, stop)

    return execute


def use_cluster(address: str) -> Executor:
    """Drive on the nodes of a Ray cluster.

    Raises: ConfigError: ray is not installed or the cluster does not answer.
    """
    cluster = RayCluster(address)

    def execute(jobs: Sequence[Job], stop: Stop) -> Iterator[tuple[Job, Outcome]]:
        for each in cluster.results(drive, jobs, stop):
            if each.result is None:
                raise AgribotError(
                    f"{each.job.name}, seed {each.job.seeds[0]}: {each.error}; look at the "
                    "node and run the same command again"
                )
            yield each.result

    return execute


def drive_all(
    jobs: Sequence[Job],
    execute: Executor,
    stop: Stop,
    done: Callable[[int], None],
    kept: KeptMissions | None = None,
) -> Iterator[tuple[Line, list[Outcome]]]:
    """One line per job, in their order, once all its seeds are driven; none after a stop.

    `done` gets how many missions there are, those included that `kept` has from before.
    """
    collected = {job.name: {} if kept is None else _pick(job, kept) for job in jobs}
    missing = [
        msgspec.structs.replace(job, seeds=(seed,))
        for job in jobs
        for seed in job.seeds
        if seed not in collected[job.name]
    ]
    done(count := sum(map(len, collected.values())))
    for job, outcome in execute(missing, stop):
        if stop():
            continue
        collected[job.name][outcome.seed] = outcome
        if kept is not None:
            kept.add(job, (outcome,))
        done(count := count + 1)
    for job in jobs:
        outcomes = [outcome for _, outcome in sorted(collected[job.name].items())]
        if len(outcomes) == len(job.seeds):
            yield line(job.name, outcomes, job.scenario.rows), outcomes


def _pick(job: Job, kept: KeptMissions) -> dict[int, Outcome]:
    found = kept.find(job)
    return {seed: found[seed] for seed in job.seeds if seed in found}
