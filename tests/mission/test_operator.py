"""Somebody presses pause, resume, stop and cancel while the robot works."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from agribot.app.simulated_run import SimulatedRun, simulate
from agribot.core import config
from agribot.core.facts import PausedByHand
from agribot.core.messages import RequestWord, TickRecord, Who
from tests.asking import BY_WORD


@pytest.fixture
def session(tmp_path: Path) -> Iterator[SimulatedRun]:
    unseen = ["perception.enabled=false", "record.enabled=false"]
    settings = config.load("farm", ["seed=2", "field.row_count=1", "field.row_length_m=3", *unseen])
    with simulate(settings, tmp_path / "run") as opened:
        yield opened


def press(session: SimulatedRun, action: RequestWord) -> None:
    session.inbox.post(BY_WORD[action])


def until(ticks: Iterator[TickRecord], t_s: float) -> TickRecord:
    return next(record for record in ticks if record.batch.t_s >= t_s)


def test_a_paused_mission_stands_and_goes_on_at_the_same_place(session: SimulatedRun) -> None:
    ticks = session.ticks()
    assert until(ticks, 15.0).estimate.v_mps > 0.2
    press(session, "pause")
    paused = until(ticks, 18.0)
    assert paused.status.state == "paused"
    before = session.simulator.truth()
    still = until(ticks, 22.0)
    after = session.simulator.truth()
    assert (after.x_map_m, after.y_map_m) == pytest.approx(
        (before.x_map_m, before.y_map_m), abs=2e-3
    )
    press(session, "resume")
    assert still.status.s_m == pytest.approx(until(ticks, 24.5).status.s_m, abs=1.0)
    for _ in ticks:
        pass
    report = session.finish()
    assert report.ok, report.reason
    assert report.mission.rows_done == 1


def test_a_stop_latches_until_it_is_cleared(session: SimulatedRun) -> None:
    ticks = session.ticks()
    until(ticks, 10.0)
    press(session, "stop")
    until(ticks, 12.0)
    press(session, "resume")  # not enough
    held = until(ticks, 15.0)
    assert held.status.state == "paused"
    assert abs(session.simulator.truth().v_mps) < 0.005
    press(session, "clear_stop")
    press(session, "resume")
    assert until(ticks, 20.0).status.state == "running"
    assert session.simulator.truth().v_mps > 0.1
    assert any(event.kind == "operator" for event in session.event_log.events)


def test_a_cancelled_mission_ends_at_rest_and_is_no_success(session: SimulatedRun) -> None:
    ticks = session.ticks()
    until(ticks, 10.0)
    press(session, "cancel")
    for _ in ticks:
        pass
    report = session.finish()
    assert not report.ok
    assert "cancelled" in report.reason
    assert abs(session.simulator.truth().v_mps) < 0.01


def test_a_hand_takes_the_robot_off_the_mission_and_lets_it_stand_when_it_lets_go(
    session: SimulatedRun,
) -> None:
    ticks = session.ticks()
    until(ticks, 15.0)
    for t_s in (15.2, 15.4, 15.6, 15.8, 16.0):
        session.inbox.drive(-0.2, 0.0, Who("gamepad"))
        by_hand = until(ticks, t_s)
    assert by_hand.status.state == "paused"
    assert session.simulator.truth().v_mps < -0.1
    until(ticks, 17.0)  # silence: the request runs out
    assert abs(session.simulator.truth().v_mps) < 0.005
    press(session, "resume")
    assert until(ticks, 19.0).status.state == "running"
    assert any(event.fact == PausedByHand("gamepad") for event in session.event_log.events)
