"""A farm mission on the real program of the motor board, executed instruction by instruction.

Every wheel sample, fix and command is bytes. By day two metres of a row, every night the farm.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from agribot.cli.main import main
from agribot.drivers.board.agribot_board import AgribotBoard, make_board
from agribot.record.replay import read_ticks
from tests import machine, nightly
from tests.mission.conftest import start_before_a_row

pytestmark = [
    pytest.mark.slow,
    nightly.by_day(
        "tests/firmware/test_firmware_platform.py::"
        "test_the_same_mission_through_bytes_and_firmware_is_decided_as_on_the_simulator",
        "tests/firmware/test_firmware_platform.py::"
        "test_a_run_on_firmware_repeats_bit_by_bit_and_so_does_its_replay",
        "tests/firmware/test_firmware_platform.py::"
        "test_noise_on_the_line_costs_frames_and_makes_no_false_number",
    ),
]
OPTIONS = ("--set", "perception.enabled=false", "--sensors", "rtk", "--headless")
FIELDS = ((1, 2.0), (6, 10.0))  # rows and their length, m
each_field = nightly.one_by_one("field", FIELDS, in_suite=1)
Field = tuple[int, float]
BOARD_PERIOD_S = 0.01
KINDS = ("mission", "gate", "stop", "hold", "resume", "ready", "fault", "limit", "row")
SETS_OFF = "mission running"


class Drive(NamedTuple):
    """A mission that was driven to its end, and the motor board's end of its line."""

    out: Path
    report: dict[str, Any]
    board: AgribotBoard | None

    def read_decisions(self) -> list[tuple[str, float]]:
        """What the robot decided and reported, without numbers, and how long after it set off."""
        lines = (self.out / "events.jsonl").read_text().splitlines()
        events = [event for event in map(json.loads, lines) if event["kind"] in KINDS]
        words = [f"{event['kind']} {event['reason']}" for event in events]
        set_off_s = events[words.index(SETS_OFF)]["t_s"]
        return [
            (_leave_out_numbers(said), event["t_s"] - set_off_s)
            for said, event in zip(words, events, strict=True)
        ]


Mission = Callable[[Field, str, str], Drive]


def _leave_out_numbers(text: str) -> str:
    return "".join(char for char in text if not char.isdigit())


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mission]:
    """`agribot run farm --platform P` over the rows of a mission; once for each name."""
    machine.require("simavr")
    root = tmp_path_factory.mktemp("missions")
    boards: list[AgribotBoard] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AGRIBOT_HOME", str(root / "home"))

        def make_and_keep(*arguments: Any) -> AgribotBoard:
            boards.append(make_board(*arguments))
            return boards[-1]

        patch.setattr("agribot.app.firmware_platform.make_board", make_and_keep)

        @cache
        def drive(field: Field, platform: str, name: str) -> Drive:
            rows, length_m = field
            out = root / f"{rows}-{platform}-{name}"
            boards.clear()
            words = ["run", "farm", "--platform", platform, *OPTIONS, "--out", str(out)]
            words += ["--set", f"field.row_count={rows}", "--set", f"field.row_length_m={length_m}"]
            with pytest.MonkeyPatch.context() as start:
                near = start_before_a_row(start) if rows == 1 else []
                words += [word for setting in near for word in ("--set", setting)]
                assert main(words) == 0
            report = json.loads((out / "report.json").read_text())
            return Drive(out, report, boards[0] if boards else None)

        yield drive


@each_field
def test_the_rows_are_driven_within_two_centimetres_and_no_plant_is_crushed(
    mission: Mission, field: Field
) -> None:
    report = mission(field, "firmware", "once").report
    assert report["ok"], report["reason"]
    assert report["mission"]["rows_done"] == report["mission"]["rows_total"] == field[0]
    assert report["tracking"]["plants_total"] == 36
    assert report["tracking"]["plants_crushed"] == 0
    assert report["tracking"]["xte_rms_m"] <= 0.02


@each_field
def test_no_frame_of_the_mission_is_broken_or_lost_at_a_hundred_a_second(
    mission: Mission, field: Field
) -> None:
    out, _, board = mission(field, "firmware", "once")
    assert board is not None
    assert (board.lost, board.broken) == (0, 0)
    ticks = list(read_ticks(out / "run.mcap"))
    for stamps_s in (
        [sample.t_s for tick in ticks for sample in tick.batch.wheels],
        [sample.t_s for tick in ticks for sample in tick.batch.imu],
    ):
        assert len(stamps_s) == pytest.approx(ticks[-1].batch.t_s / BOARD_PERIOD_S, abs=5)
        steps_s = [after - before for before, after in itertools.pairwise(stamps_s)]
        assert max(steps_s) < 1.5 * BOARD_PERIOD_S


@each_field
def test_the_mission_is_decided_as_on_the_simulators_own_board(
    mission: Mission, field: Field
) -> None:
    by_bytes, by_sim = mission(field, "firmware", "once"), mission(field, "sim", "once")
    told, meant = by_bytes.read_decisions(), by_sim.read_decisions()
    assert [words for words, _ in told] == [words for words, _ in meant]
    # The board reads the compass four times as often, so that the robot sets off 0.9 s sooner.
    apart_s = [a - b for (_, a), (_, b) in zip(told, meant, strict=True) if a > 0.0]
    assert max(map(abs, apart_s)) < 0.3
    assert by_bytes.report["tracking"]["xte_rms_m"] == pytest.approx(
        by_sim.report["tracking"]["xte_rms_m"], abs=0.002
    )


@pytest.mark.parametrize("field", [pytest.param(FIELDS[-1], marks=pytest.mark.nightly)])
def test_a_second_mission_is_the_same_to_the_last_bit(mission: Mission, field: Field) -> None:
    once = read_ticks(mission(field, "firmware", "once").out / "run.mcap")
    again = read_ticks(mission(field, "firmware", "again").out / "run.mcap")
    for one, other in zip(once, again, strict=True):
        assert one.batch == other.batch
        assert one.command == other.command
