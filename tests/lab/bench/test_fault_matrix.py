"""The matrix of `agribot bench faults`: its cells, how it goes on, and what its verdicts say."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.lab.bench.fault_matrix import cells as matrix
from agribot.lab.bench.fault_matrix.cells import Cell
from agribot.lab.bench.fault_matrix.covering import cover_pairs
from agribot.lab.bench.fault_matrix.driving import CellResult
from agribot.lab.bench.fault_matrix.states import STATES
from agribot.lab.bench.fault_matrix.verdict import CellVerdict, find_usual_across_m, judge
from agribot.record.events import Event
from agribot.sim.faults.schedule import parse_fault
from agribot.sim.faults.table import FAULTS
from agribot.sim.safety_judge import Crush


def test_each_pair_that_is_allowed_has_a_row_and_no_other_row_is_there() -> None:
    factors = (("a", "b", "c"), ("1", "2"), ("x", "y", "z"), ("p", "q"))

    def is_allowed(row: tuple[str, ...]) -> bool:
        return row[:2] != ("a", "1") and (row[0], row[2]) != ("b", "x")

    rows = cover_pairs(factors, is_allowed)
    whole = [row for row in itertools.product(*factors) if is_allowed(row)]

    def list_pairs(rows: object) -> set[tuple[tuple[int, str], ...]]:
        return {pair for row in rows for pair in itertools.combinations(enumerate(row), 2)}  # type: ignore[attr-defined]

    assert list_pairs(rows) == list_pairs(whole)
    assert all(map(is_allowed, rows))
    assert len(rows) < len(whole) / 2


def test_the_array_has_every_fault_in_every_state_that_it_may_begin_in() -> None:
    cells = matrix.list_singles(matrix.FAULTS, (1, 2, 3), is_all=False)
    of_table = {kind.name for kind in FAULTS if kind.part not in ("camera", "network")}
    assert {parse_fault(f"{fault}@0").name for fault in matrix.FAULTS} == of_table
    every = {(cell.fault, cell.state) for cell in cells}
    names = {state.name for state in STATES}
    assert {state for fault, state in every if fault == "motor.runaway"} == names
    assert {state for fault, state in every if fault == "start.aside=1"} == {"before the start"}
    assert len({cell.name for cell in cells}) == len(cells) < 450
    two = matrix.list_pairs((1, 2, 3), is_all=False)
    pairs = {(cell.fault, cell.also) for cell in two}
    assert len(pairs) == len(matrix.HIDDEN) * len(matrix.SECOND) - 1  # not two biases of a gyro
    for cell in (*cells, *two):
        onset_s = 0.0 if cell.state == "before the start" else 12.34
        for text in cell.list_faults(onset_s):
            parse_fault(text)


@pytest.mark.parametrize(
    ("course", "texts"),
    [
        ("once", ("imu.bias=0.05@7.5+2",)),
        ("for good", ("imu.bias=0.05@7.5",)),
        ("grows", ("imu.bias=0.05@7.5~60",)),
        (
            "comes and goes",
            tuple(f"imu.bias=0.05@{t_s:g}+0.4" for t_s in (7.5, 11.5, 15.5, 19.5, 23.5)),
        ),
    ],
)
def test_a_course_is_written_as_faults_of_a_run(course: str, texts: tuple[str, ...]) -> None:
    cell = Cell(seed=1, script="plain", fault="imu.bias=0.05", state="turn", course=course)
    assert cell.list_faults(7.5) == texts


def result(*events: Event, crushed_s: tuple[float, ...] = (), **more: float) -> CellResult:
    cell = Cell(seed=1, script="plain", fault="motor.runaway", state="turn", course="for good")
    begins = Event(t_s=10.0, kind="injected", reason="motor.runaway@10 begins")
    return CellResult(
        cell=cell, onset_s=10.0, events=(begins, *events), plants=50,
        crushes=tuple(Crush(t_s=t_s, by="wheel") for t_s in crushed_s),
        way=tuple((t_s / 2.0, t_s / 4.0) for t_s in range(60)), **more,  # type: ignore[arg-type]
    )  # fmt: skip


USUAL = CellResult(cell=Cell(seed=1, script="plain"), across_p95_m=0.03, across_max_m=0.05)
STOP = Event(
    t_s=10.5, kind="stop", reason="wheels turn too fast", code="runs_on", parts=("wheels",)
)


def judge_one(*events: Event, crushed_s: tuple[float, ...] = (), **more: float) -> CellVerdict:
    found = result(*events, crushed_s=crushed_s, **more)
    return judge(found, USUAL, find_usual_across_m([USUAL]))


def test_a_cell_says_when_it_was_noticed_how_far_it_drove_and_what_it_crushed() -> None:
    verdict = judge_one(STOP, crushed_s=(10.2,), across_max_m=0.04)
    assert (verdict.noticed_s, verdict.is_named, verdict.reaction) == (0.5, True, "stopped")
    assert verdict.way_m == pytest.approx(9.5)
    assert (verdict.crushed, verdict.crushed_noticeable, verdict.red) == (1, 0, ())


def test_red_is_what_was_crushed_left_rolled_or_not_noticed_after_it_was_noticeable() -> None:
    assert judge_one(STOP, crushed_s=(10.2, 11.0)).red == (
        "1 plants crushed after it was noticed or noticeable",
    )
    assert judge_one(STOP, outside_m=0.3).red == ("0.30 m outside",)
    assert judge_one(STOP, rolled_m=12.0).red == ("12.0 m rolled while it had to stand",)
    assert judge_one(across_max_m=0.30).red == ("not noticed, and not harmless",)
    harmless = judge_one(across_max_m=0.05)
    assert (harmless.is_harmless, harmless.red) == (True, ())


def test_a_part_that_is_well_and_named_first_is_accused() -> None:
    wrong = Event(t_s=10.1, kind="fault", reason="GNSS creeps", code="creeps", parts=("gnss",))
    verdict = judge_one(wrong, STOP)
    assert (verdict.accused, verdict.blamed) == (("gnss",), ("gnss",))
    assert verdict.red == ("gnss accused first",)
    later = judge_one(STOP, wrong)
    assert (later.accused, later.blamed, later.red) == ((), ("gnss",), ())
    usual = CellResult(cell=USUAL.cell, events=(wrong,))  # it says so without a fault, too
    assert judge(result(wrong, STOP), usual, 0.05).blamed == ()


def test_a_matrix_is_driven_in_parts_and_no_cell_twice(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(matrix, "STATES", [s for s in STATES if s.name in ("waiting", "turn")])
    monkeypatch.setattr(matrix, "COURSES", ("once", "for good"))
    monkeypatch.setattr(matrix, "LONGEST_S", 3.0)
    page = tmp_path / "page.md"
    page.write_text("# Measured\n<!-- campaign: matrix -->\n<!-- end of matrix -->\n")
    words = ["bench", "faults", "--faults", "bumper.contact", "--seeds", "1", "--workers", "1",
             "--out", str(tmp_path / "out"), "--json"]  # fmt: skip
    assert main([*words, "--shard", "1/4"]) == 0
    kept = {p: p.stat().st_mtime_ns for p in (tmp_path / "out" / "cells").iterdir()}
    assert len(kept) == 2  # the drive without a fault, and a cell
    capsys.readouterr()
    assert main([*words, "--markdown", str(page)]) == 0
    assert {p: p.stat().st_mtime_ns for p in kept} == kept
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (found["cells"], found["missions_without_fault"], found["red"]) == (2, 1, 0)
    assert found["detected_ratio"] == found["named_ratio"] == 1.0
    assert found["never_began"] == 2  # within three seconds it never turns
    assert "|`bumper.contact`|0.0" in page.read_text()
    assert page.with_suffix(".csv").read_text().startswith("fault,also,state,course,seed,")
    assert not list((tmp_path / "out" / "runs").glob("*/*"))
