"""`agribot bench long`: one mission of many kilometres, and how often it needed a person."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from agribot.cli.ranges import threads
from agribot.cli.tools.sweep import drive, status
from agribot.core import extras
from agribot.core.errors import explain_os_error
from agribot.core.whole_file import write_at_once
from agribot.lab.sweep.plan import read_seeds

PLAN = "plan.geojson"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--km", type=float, default=50.0, metavar="KM",
        help="approximate length of the way of each mission (default: %(default)g)",
    )  # fmt: skip
    parser.add_argument(
        "--mps", type=float, metavar="MPS", help="speed along the swaths (default: as of a mission)"
    )
    parser.add_argument("--seeds", default="1", metavar="LIST", help="default: %(default)s")
    parser.add_argument(
        "--workers", type=threads, default=1,
        help="processes, one mission each (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, default=Path("runs/long"), metavar="DIR",
        help="missions that were cut off there go on, finished ones are not driven again (default: "
        "%(default)s)",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Return 1 where a mission failed."""
    from agribot.lab.bench import long_mission
    from agribot.lab.sweep.execution import ProcessExecutor
    from agribot.lab.sweep.tables import SweepFolder

    extras.require("sim", "agribot bench long")
    out = options.out.resolve()
    text = long_mission.make_plan(options.km)
    jobs = long_mission.list_jobs(options.km, out / PLAN, read_seeds(options.seeds), options.mps)
    folder = SweepFolder(out, jobs)
    with explain_os_error(f"cannot write into {out}", "name another folder with --out"):
        write_at_once(out / PLAN, text.encode())
    executor = ProcessExecutor(options.workers, long_mission.go_on)
    ways = long_mission.ProgressLine([folder.run_dir(job) for job in jobs])
    result = drive(folder, executor, ways)
    summary = long_mission.summarise(list(folder.read_finished().values()))
    each, memory_mb = summary["km_per_intervention"], summary["memory_mb"]
    sys.stdout.write(
        f"{summary['km']:.2f} km in {summary['hours']:.2f} h, needed a person "
        f"{summary['interventions']} times{'' if each is None else f', every {each:.2f} km'}; "
        f"{summary['cpu_s']:.0f} s of a CPU{'' if memory_mb is None else f', {memory_mb:.0f} MB'}\n"
    )
    if options.json:
        sys.stdout.write(json.dumps({"folder": str(options.out), **summary}) + "\n")
    return status(result)
