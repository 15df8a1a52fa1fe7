"""A motor board that drives on against all commands, and the contactor that cuts its power."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import NamedTuple, get_args
from unittest.mock import ANY

import pytest

from agribot.app.simulated_run import SimulatedRun, simulate
from agribot.core.config import load
from agribot.core.facts import (
    ButtonPressed,
    ContactorSilent,
    ContactorWelded,
    Fact,
    Runaway,
    StoppedBy,
    Wheel,
    WheelsWrong,
)
from agribot.core.messages import ClearStop, RequestWord, TickRecord, Who
from tests.asking import BY_WORD
from tests.finding import holds, is_like

IN_ROW_S, FAULT_S = 21.0, 8.0  # the second is in the first turn
QUICK = ["perception.enabled=false", "record.enabled=false", "sim.sensors='rtk'", "seed=1"]


class Drive(NamedTuple):
    run: SimulatedRun
    ticks: list[TickRecord]
    way_m: list[float]  # from where the robot was when it was stopped


def drive(out: Path, fault: str, *more: str, from_s: float = FAULT_S) -> Drive:
    """Drive the farm until 7 s after a fault, and clear the stop 1.5 s before the end."""
    until_s = from_s + 7.0
    settings = load("farm", [*QUICK, f"faults={fault}", f"duration_s={until_s}", *more])
    ticks, way_m, stop_xy = [], [], None
    with simulate(settings, out) as run:
        for record in run.ticks():
            ticks.append(record)
            truth = run.simulator.truth()
            if stop_xy is None and record.status.stopped:
                stop_xy = truth.x_map_m, truth.y_map_m
            if stop_xy is not None:
                way_m.append(math.dist(stop_xy, (truth.x_map_m, truth.y_map_m)))
            if abs(record.batch.t_s - (until_s - 1.5)) < 0.005:
                run.inbox.post(ClearStop(), Who("Ann"))
        run.finish()
    return Drive(run, ticks, way_m)


def test_a_board_that_runs_away_is_stopped_by_the_contactor_within_two_metres(
    tmp_path: Path,
) -> None:
    out = tmp_path / "run"
    run, ticks, way_m = drive(out, f"motor.runaway@{IN_ROW_S}+5", from_s=IN_ROW_S)
    cut = [tick for tick in ticks if tick.command.is_power_cut]
    assert 0.5 < cut[0].batch.t_s - IN_ROW_S < 1.5
    assert holds(cut[0].fact, Runaway(ANY, is_cut=True, is_contactor_stuck=False))
    assert 0.2 < max(way_m) < 2.0
    at_rest = [tick for tick in ticks if IN_ROW_S + 4.5 < tick.batch.t_s < IN_ROW_S + 5.4]
    assert all(tick.batch.contactor[-1].is_closed is False for tick in at_rest)
    assert run.referee.crushed == set()
    report = json.loads((out / "report.json").read_text())
    (told,) = report["safety"]["faults"]
    assert told["reaction"] == "stopped"
    assert report["safety"]["outside_m_max"] == 0.0
    assert not ticks[-1].command.is_power_cut, "cleared at rest, it closes again"
    assert ticks[-1].batch.contactor[-1].is_closed


class Stand(NamedTuple):
    cut_after_s: float | None  # from the fault
    way_m: float
    last: TickRecord


def stand(out: Path, action: RequestWord, *more: str) -> Stand:
    """Drive the farm for 4 s, stop or pause it, and let the board run away 2 s later."""
    fault_s = 6.0
    settings = [*QUICK, f"faults=motor.runaway@{fault_s}", f"duration_s={fault_s + 4.0}", *more]
    with simulate(load("farm", settings), out) as run:
        ticks = run.ticks()
        next(record for record in ticks if record.batch.t_s > 4.0)
        run.inbox.post(BY_WORD[action], Who("Ann"))
        next(record for record in ticks if record.batch.t_s > fault_s - 0.05)
        stood, cut_s = run.simulator.truth(), None
        for record in ticks:
            if record.command.is_power_cut and cut_s is None:
                cut_s = record.batch.t_s - fault_s
        truth = run.simulator.truth()
    way_m = math.dist((stood.x_map_m, stood.y_map_m), (truth.x_map_m, truth.y_map_m))
    return Stand(cut_s, way_m, record)


@pytest.mark.parametrize("action", ["stop", "pause"])
def test_a_board_that_sets_off_while_the_robot_stands_is_cut_off_within_half_a_metre(
    action: RequestWord, tmp_path: Path
) -> None:
    cut_after_s, way_m, last = stand(tmp_path / "run", action)
    assert cut_after_s is not None
    assert cut_after_s < 0.5
    assert 0.02 < way_m < 0.5
    why: dict[str, Fact] = {
        "stop": StoppedBy("Ann"),
        "pause": WheelsWrong(get_args(Wheel), "fast", ANY, ANY),
    }
    assert is_like(last.status.stopped_fact, why[action])


def test_a_board_that_sets_off_without_a_contactor_is_reported_with_what_to_do(
    tmp_path: Path,
) -> None:
    cut_after_s, _, last = stand(tmp_path / "run", "stop", "sim.contactors=0")
    assert cut_after_s is None
    told = last.status.gate.warning_fact
    assert holds(told, Runaway(ANY, is_cut=False, is_contactor_stuck=False), WheelsWrong)


def test_without_a_contactor_nothing_stops_it_but_the_red_button(tmp_path: Path) -> None:
    fault = f"motor.runaway@{FAULT_S}"
    _, ticks, way_m = drive(tmp_path / "run", fault, "sim.contactors=0")
    assert not any(tick.command.is_power_cut or tick.batch.contactor for tick in ticks)
    assert way_m[-1] > 3.0
    by_button = Runaway(ANY, is_cut=False, is_contactor_stuck=False)
    assert any(holds(tick.fact, by_button) for tick in ticks)


def test_where_one_of_two_contactors_is_welded_the_other_stops_it_and_it_drives_no_more(
    tmp_path: Path,
) -> None:
    faults = f"motor.runaway@{FAULT_S}+4;contactor.welded@1"
    run, ticks, way_m = drive(tmp_path / "run", faults)
    assert 0.2 < max(way_m) < 2.0
    stops = run.referee.score_safety()
    assert stops.stops_too_long == 0
    assert 0.7 * (stops.stop_allowed_m or math.inf) < max(way_m), "it is no empty promise"
    assert holds(ticks[-1].fact, ContactorWelded), "also after the stop is cleared"
    assert ticks[-1].command.is_power_cut


def test_a_single_contactor_that_is_welded_does_not_stop_it_and_calls_for_the_red_button(
    tmp_path: Path,
) -> None:
    faults = f"motor.runaway@{FAULT_S};contactor.welded@1"
    _, ticks, way_m = drive(tmp_path / "run", faults, "sim.contactors=1")
    assert way_m[-1] > 3.0
    assert any(tick.command.is_power_cut for tick in ticks)
    stuck = Runaway(ANY, is_cut=False, is_contactor_stuck=True)
    assert any(holds(tick.fact, stuck) for tick in ticks)


@pytest.mark.parametrize("fault", ["contactor.silent", "button.pressed"])
def test_a_robot_that_loses_its_power_rolls_out_and_says_why(fault: str, tmp_path: Path) -> None:
    run, ticks, way_m = drive(tmp_path / "run", f"{fault}@{FAULT_S}+4")
    causes: dict[str, type[Fact]] = {
        "contactor.silent": ContactorSilent,
        "button.pressed": ButtonPressed,
    }
    assert any(holds(tick.status.stopped_fact, causes[fault]) for tick in ticks)
    assert 0.01 < max(way_m) < 1.0
    assert run.referee.crushed == set()
    assert not ticks[-1].command.is_power_cut
