"""`agribot bench nav`: the navigation benchmark ROWS-10x12."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from agribot.cli.counting import CountProgress
from agribot.cli.ranges import check_within, finite
from agribot.cli.stopping import stop_on_signal
from agribot.cli.tools.sweep import add_workers
from agribot.core import extras
from agribot.core.errors import ConfigError
from agribot.lab.sweep.plan import read_seeds

if TYPE_CHECKING:
    from agribot.lab.bench.nav.job import Job
    from agribot.lab.bench.nav.judge import Outcome
    from agribot.lab.bench.nav.table import Line

    Results = list[tuple[Line, list[Outcome]]]

MAX_SPEED_MPS = 1.0
FORMER_NAMES = {"hector": "seed"}  # former names of presets, in this command
# The field belongs to the benchmark, the rest of the program does not run in it.
OWN_SETTINGS = ("control", "estimate", "mission")
MAX_ROWS = 100
GOOD_RATIO = 0.95  # share of a line's missions, for status 0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seeds", default="20000-20019", metavar="LIST", help="such as 1-100")
    parser.add_argument(
        "--sensors", metavar="PRESET",
        help="ideal, rtk, rtk-1, rtk-dual, rtk-trees, m8n, m8n-1, m8n-urban, legacy or seed "
        "(default: the published table)",
    )  # fmt: skip
    parser.add_argument("--variant", choices=("nominal", "hard"), default="nominal")
    parser.add_argument(
        "--vision", action=argparse.BooleanOptionalAction, default=True,
        help="row line from a camera; with --sensors",
    )  # fmt: skip
    parser.add_argument("--speed", type=finite, default=0.8, metavar="MPS", help="in the rows")
    parser.add_argument("--rows", type=int, default=10, metavar="N", help="of the field")
    parser.add_argument(
        "--set", action="append", default=[], metavar="A.B=C", help="any setting of the robot"
    )
    parser.add_argument(
        "--perfect", action="append", default=[], choices=("fixes", "heading"),
        help="give the robot the truth instead of what this sensor says",
    )  # fmt: skip
    parser.add_argument(
        "--baseline", action="store_true", help="also drive the original robot's controller"
    )
    parser.add_argument(
        "--integrity", action="store_true",
        help="also write how the protection level held: events per row-km, availability",
    )  # fmt: skip
    add_workers(parser)
    parser.add_argument("--ray", metavar="ADDRESS", help="a Ray cluster instead of processes")
    parser.add_argument(
        "--out", type=Path, metavar="DIR",
        help="keep finished missions and tables there; the same command drives only what is "
        "missing",
    )  # fmt: skip
    parser.add_argument("--plot", type=Path, metavar="PNG", help="draw all missions there")
    parser.add_argument("--markdown", action="store_true", help="write the table as Markdown")


def run(options: argparse.Namespace) -> int:
    _check(options)
    from agribot.lab.bench.nav.kept import KeptMissions
    from agribot.lab.bench.nav.suite import drive_all, use_cluster, use_processes

    jobs = _list_jobs(options, read_seeds(options.seeds))
    kept = None if options.out is None else KeptMissions(options.out / "missions.jsonl")
    execute = use_cluster(options.ray) if options.ray else use_processes(options.workers)
    progress = CountProgress(sum(len(job.seeds) for job in jobs), "missions")
    with stop_on_signal() as stop:
        results = list(drive_all(jobs, execute, lambda: bool(stop), progress, kept))
        progress.close()
        interrupted = bool(stop)
    _write(options, results)
    if interrupted:
        if options.out:
            sys.stderr.write("agribot: interrupted; finished missions are kept, the same command "
                             "drives the rest\n")  # fmt: skip
        return 130
    own = [entry for entry, _ in results if not entry.name.startswith("original")]
    return 0 if all(entry.missions_ok >= GOOD_RATIO * entry.missions for entry in own) else 1


def _check(options: argparse.Namespace) -> None:
    check_within("--speed", options.speed, 0.1, MAX_SPEED_MPS, "m/s")
    check_within("--rows", options.rows, 1, MAX_ROWS)
    for setting in options.set:
        if setting.partition(".")[0] not in OWN_SETTINGS:
            groups = ", ".join(OWN_SETTINGS)
            raise ConfigError(
                f"--set {setting}: the benchmark changes settings of {groups} only; leave it out"
            )
    if options.plot:
        extras.require("report", "--plot")


def _write(options: argparse.Namespace, results: Results) -> None:
    """Write the tables, and what else was asked for."""
    from agribot.lab.bench.nav.plot import plot
    from agribot.lab.bench.nav.table import level_text, text

    lines = [entry for entry, _ in results]
    sys.stderr.write(text(lines, markdown=options.markdown) + "\n")
    if options.integrity:
        sys.stderr.write(level_text(lines, markdown=options.markdown) + "\n")
    if options.plot and results:
        plot(options.plot, [(entry.name, outcomes) for entry, outcomes in results])
    content = {
        "seeds": options.seeds,
        "cpu_s": sum(entry.cpu_s for entry in lines),
        "lines": msgspec.to_builtins(lines),
        "missions": {entry.name: msgspec.to_builtins(outcomes) for entry, outcomes in results},
    }
    if options.out:
        _write_tables(options.out, lines, content)
    if options.json:
        sys.stdout.write(json.dumps(content) + "\n")


def _write_tables(folder: Path, lines: Sequence[Line], content: dict[str, Any]) -> None:
    from agribot.core.whole_file import write_at_once
    from agribot.lab.bench.nav.table import level_text, text

    tables = f"{text(lines, markdown=True)}\n\n{level_text(lines, markdown=True)}\n"
    write_at_once(folder / "nav.md", tables.encode())
    write_at_once(folder / "nav.json", json.dumps(content).encode() + b"\n")


def _list_jobs(options: argparse.Namespace, seeds: Sequence[int]) -> list[Job]:
    from agribot.description.loader import load_robot
    from agribot.lab.bench.nav import suite
    from agribot.lab.bench.nav.scenario import make_scenario

    robot, sensors = load_robot(), FORMER_NAMES.get(options.sensors, options.sensors)
    if sensors is None:
        jobs = suite.plan_published(seeds, robot, options.speed, baseline=options.baseline)
    else:
        what = make_scenario(
            sensors, vision=options.vision, speed_mps=options.speed, variant=options.variant
        )
        jobs = [suite.choose(seeds, robot, what)]
        if options.baseline:
            preset = _choose_original(sensors)
            jobs += suite.plan_originals(seeds, robot, (preset,), options.variant)
    return [_alter(job, options) for job in jobs]


def _choose_original(sensors: str) -> str:
    """Choose the preset of the original robot, which has one antenna and a magnetometer."""
    from agribot.sim.sensors.presets import load_preset

    if load_preset(sensors).mag == "none":
        raise ConfigError(
            f"--baseline: the original robot needs a magnetometer, {sensors} has none; "
            "leave --baseline out"
        )
    return "rtk" if sensors == "rtk-dual" else sensors


def _alter(job: Job, options: argparse.Namespace) -> Job:
    """Give a job the field and the settings that were asked for; check them before any drives."""
    from agribot.lab.bench.nav.robot import equip

    scenario = msgspec.structs.replace(job.scenario, rows=options.rows)
    if not job.is_original:
        scenario = msgspec.structs.replace(
            scenario, settings=tuple(options.set), perfect=tuple(options.perfect)
        )

    scenario.config(job.seeds[0])
    equip(job.robot, scenario.sensors)
    return msgspec.structs.replace(job, scenario=scenario)
