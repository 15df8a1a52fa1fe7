"""`agribot bench nav`: the navigation benchmark ROWS-10x12."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from agribot.app.workers import usable_cpus
from agribot.cli.counting import CountProgress
from agribot.cli.ranges import check_workers, finite
from agribot.cli.stopping import stop_on_signal
from agribot.core import extras
from agribot.core.errors import ConfigError
from agribot.lab.sweep.plan import read_seeds

if TYPE_CHECKING:
    from agribot.lab.bench.nav.job import Job

MAX_SPEED_MPS = 1.0
STACK_PRESETS = ("rtk-1", "m8n-1", "m8n-urban", "rtk-trees")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seeds", default="20000-20499", metavar="LIST", help="such as 1-100")
    parser.add_argument(
        "--sensors",
        choices=("legacy", "hector", "m8n", "rtk", "rtk-dual", *STACK_PRESETS),
        help="one receiver (default: the published table); those of robots without a magnetometer "
        f"({', '.join(STACK_PRESETS)}) are driven by the whole filter, some CPU seconds a mission",
    )  # fmt: skip
    parser.add_argument("--variant", choices=("nominal", "hard"), default="nominal")
    parser.add_argument(
        "--vision", action=argparse.BooleanOptionalAction, default=True,
        help="row line from a camera; with --sensors",
    )  # fmt: skip
    parser.add_argument("--speed", type=finite, default=0.8, metavar="MPS", help="in the rows")
    parser.add_argument(
        "--baseline", action="store_true", help="also drive the original robot's controller"
    )
    parser.add_argument(
        "--integrity", action="store_true",
        help="also hold the protection level against the truth: events per row-km, availability",
    )  # fmt: skip
    parser.add_argument(
        "--workers", type=int, default=usable_cpus(), help="processes (default: one for each CPU)"
    )
    parser.add_argument(
        "--keep", type=Path, metavar="FILE",
        help="put finished missions there, and drive none again that is there already",
    )  # fmt: skip
    parser.add_argument("--plot", type=Path, metavar="PNG", help="draw all missions there")
    parser.add_argument("--markdown", action="store_true", help="write the table as Markdown")
    parser.add_argument("--json", action="store_true", help="print the results as the last line")


def run(options: argparse.Namespace) -> int:
    if not 0.1 <= options.speed <= MAX_SPEED_MPS:
        raise ConfigError(f"--speed {options.speed:g}: must be from 0.1 to {MAX_SPEED_MPS:g} m/s")
    check_workers(options.workers)
    if options.plot:
        extras.require("report", "--plot")
    from agribot.lab.bench.nav.kept import KeptMissions
    from agribot.lab.bench.nav.plot import plot
    from agribot.lab.bench.nav.suite import drive_all
    from agribot.lab.bench.nav.table import level_text, text

    seeds = read_seeds(options.seeds)
    jobs = [
        msgspec.structs.replace(job, has_level=options.integrity)
        for job in _list_jobs(options, seeds)
    ]
    kept = None if options.keep is None else KeptMissions(options.keep)
    progress = CountProgress(sum(len(job.seeds) for job in jobs), "missions")
    count = 0
    with stop_on_signal() as stop:

        def done(seeds: Sequence[int]) -> None:
            nonlocal count
            count += len(seeds)
            progress(count)

        results = list(drive_all(jobs, options.workers, lambda: bool(stop), done, kept))
        progress.close()
        interrupted = bool(stop)
    lines = [entry for entry, _ in results]
    sys.stderr.write(text(lines, markdown=options.markdown) + "\n")
    if options.integrity:
        sys.stderr.write(level_text(lines, markdown=options.markdown) + "\n")
    if options.plot and results:
        plot(options.plot, [(entry.name, outcomes) for entry, outcomes in results])
    if options.json:
        missions = {entry.name: msgspec.to_builtins(outcomes) for entry, outcomes in results}
        content = {
            "seeds": options.seeds,
            "lines": msgspec.to_builtins(lines),
            "missions": missions,
        }
        sys.stdout.write(json.dumps(content) + "\n")
    if interrupted:
        if options.keep:
            sys.stderr.write("agribot: interrupted; finished missions are kept, the same command "
                             "drives the rest\n")  # fmt: skip
        return 130
    own = [entry for entry in lines if not entry.name.startswith("original")]
    return 0 if all(entry.missions_ok >= 0.95 * entry.missions for entry in own) else 1


def _list_jobs(options: argparse.Namespace, seeds: Sequence[int]) -> list[Job]:
    from agribot.description.loader import load_robot
    from agribot.lab.bench.nav import suite
    from agribot.lab.bench.nav.scenario import Receiver, scenario

    robot = load_robot()
    if options.sensors is None:
        return suite.plan_published(seeds, robot, options.speed, baseline=options.baseline)
    what = scenario(
        options.sensors, vision=options.vision, speed_mps=options.speed, variant=options.variant
    )
    jobs = [suite.chosen(seeds, robot, what)]
    if options.baseline and what.is_of_stack:
        raise ConfigError(
            f"--baseline: the original robot needs a magnetometer, {options.sensors} has none; "
            "leave --baseline out"
        )
    if options.baseline:
        receiver: Receiver = "rtk" if options.sensors == "rtk-dual" else options.sensors
        jobs += suite.originals(seeds, robot, (receiver,), options.variant)
    return jobs
