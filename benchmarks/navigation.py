"""The tables of docs/results/navigation.md that the benchmark makes, and why a line fails.

`nice -n 10 python benchmarks/navigation.py [FIRST-LAST] [FOLDER] [WORKERS]`, for instance
`20000-20003 runs/navigation 2`. FOLDER gets `published.md`, `originals.md`, `causes.md`, and
`missions.jsonl` with all missions: what is finished is not driven again, so that a second call with
more seeds adds only those. A mission takes about three CPU seconds, all tables about 80 for each
seed.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from agribot.description.loader import load_robot
from agribot.lab.bench.nav.job import Job
from agribot.lab.bench.nav.kept import KeptMissions
from agribot.lab.bench.nav.scenario import Scenario, SoilDrift, Vision, make_scenario
from agribot.lab.bench.nav.suite import (
    ORIGINAL,
    choose,
    drive_all,
    plan_originals,
    plan_published,
    use_processes,
)
from agribot.lab.bench.nav.table import level_text, text
from agribot.lab.sweep.plan import read_seeds

TREES = make_scenario("rtk-trees", vision=False)
HARD = make_scenario("rtk", vision=True, variant="hard")
FEW_ROWS = 4  # of the lines that show a cause


def plan_causes() -> dict[str, Scenario]:
    """List scenarios in which one thing differs from a line that fails."""
    replace = msgspec.structs.replace
    assert HARD.vision is not None
    bright = replace(HARD.vision, dropout_max_s=Vision().dropout_max_s)
    sharp = replace(Vision(), dropout_max_s=HARD.vision.dropout_max_s)
    return {
        "rtk-trees": TREES,
        "rtk-trees, perfect heading": replace(TREES, perfect=("heading",)),
        "rtk-trees, perfect fixes": replace(TREES, perfect=("fixes",)),
        "rtk-trees, protection_risk 0.05": replace(
            TREES, settings=("estimate.protection_risk=0.05",)
        ),
        "rtk-trees, max_row_std_m 0.25": replace(TREES, settings=("mission.max_row_std_m=0.25",)),
        **{
            f"{sensors} + vision, hard{what}": replace(each, sensors=sensors)
            for sensors in ("rtk", "m8n")
            for what, each in (
                ("", HARD),
                (", dropouts as nominal", replace(HARD, vision=bright)),
                (", noise and delay as nominal", replace(HARD, vision=sharp)),
                (", soil as nominal", replace(HARD, soil=SoilDrift())),
            )
        },
    }


def main() -> None:
    words = sys.argv[1:] + ["20000-20003", "runs/navigation", "2"][len(sys.argv) - 1 :]
    seeds, folder, workers = read_seeds(words[0]), Path(words[1]), int(words[2])
    robot, kept = load_robot(), KeptMissions(folder / "missions.jsonl")
    causes = [
        choose(seeds, robot, msgspec.structs.replace(each, rows=FEW_ROWS))
        for each in plan_causes().values()
    ]
    tables = {
        "published": plan_published(seeds, robot, 0.8, baseline=False),
        "originals": plan_originals(seeds, robot, ORIGINAL, "nominal"),
        "causes": causes,
    }
    for name, jobs in tables.items():
        names = list(plan_causes()) if name == "causes" else [job.name for job in jobs]
        (folder / f"{name}.md").write_text(measure(jobs, names, kept, workers))


def measure(jobs: Sequence[Job], names: Sequence[str], kept: KeptMissions, workers: int) -> str:
    """Drive what is missing, and write the tables of missions and of protection levels."""
    lines = []
    for job, name in zip(jobs, names, strict=True):
        for line, _ in drive_all([job], use_processes(workers), lambda: False, _report, kept):
            lines.append(msgspec.structs.replace(line, name=name))
            sys.stderr.write(f"{text(lines[-1:])}\n")
    return f"{text(lines, markdown=True)}\n\n{level_text(lines, markdown=True)}\n"


def _report(count: int) -> None:
    sys.stderr.write(f"{count} ")
    sys.stderr.flush()


if __name__ == "__main__":
    main()
