"""A battery that runs down: a warning that calls the robot home, then a stop."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.autonomy.control.battery_watch import LASTING_S, BatteryWatch
from agribot.autonomy.plan.mission.errand import STOPPING
from agribot.autonomy.plan.mission.mission import Mission
from agribot.core.config import SafetyConfig
from agribot.core.errors import MissionError
from agribot.core.fact_text import render
from agribot.core.facts import (
    BatteryEmpty,
    BatteryLow,
    Both,
    ErrandRefused,
    OwnPathOnly,
    Said,
    StopToClear,
)
from agribot.core.messages import STOP, BatterySample, DriveCommand, Path, SensorBatch
from agribot.record.events import EventSieve
from tests.autonomy.control.kinematic_rover import TICK_S
from tests.autonomy.control.test_supervisor import Gate, assert_stopped
from tests.autonomy.plan.paper_task import PaperTask
from tests.autonomy.plan.planting import MISSION
from tests.autonomy.plan.test_mission_errands import HEADLAND, Drive
from tests.autonomy.plan.test_mission_resume import ROWS, plan, ride
from tests.autonomy.plan.test_mission_states import Ride
from tests.record import record_samples

AHEAD = DriveCommand(v_mps=0.3)
SIX_CELLS = SafetyConfig(low_battery_v=21.0, empty_battery_v=19.0)


def sample(t_s: float, charge_ratio: float, voltage_v: float = 24.0) -> BatterySample:
    return BatterySample(t_s=t_s, voltage_v=voltage_v, current_a=1.0, charge_ratio=charge_ratio)


def low(percent: float) -> BatteryLow:
    return BatteryLow(percent, 20.0)


def watched(
    *values: tuple[float, float], config: SafetyConfig | None = None, seconds: int = 10
) -> BatteryWatch:
    """Charge and voltage, each for some seconds, once a second."""
    watch, t_s = BatteryWatch(config or SafetyConfig()), 0.0
    for charge_ratio, voltage_v in values:
        for _ in range(seconds):
            t_s += 1.0
            watch.update(SensorBatch(t_s=t_s, battery=(sample(t_s, charge_ratio, voltage_v),)))
    return watch


@pytest.mark.parametrize(
    ("charge_ratio", "is_low", "is_empty"),
    [(1.0, False, False), (0.21, False, False), (0.19, True, False), (0.05, True, True)],
)
def test_the_charge_decides_where_it_is_known(
    charge_ratio: float, is_low: bool, is_empty: bool
) -> None:
    watch, percent = watched((charge_ratio, 1.0), config=SIX_CELLS), 100.0 * charge_ratio
    assert watch.low == (low(percent) if is_low else None)
    assert watch.empty == (BatteryEmpty(percent, 8.0) if is_empty else None)


def test_the_voltage_decides_where_the_charge_is_not_known_and_the_pack_is() -> None:
    by_voltage = BatteryLow(left_v=20.5, limit_v=21.0)
    assert watched((math.nan, 20.5), config=SIX_CELLS).low == by_voltage
    assert watched((math.nan, 18.5), config=SIX_CELLS).empty
    assert watched((math.nan, 18.5)).low is None


def test_without_a_battery_or_its_numbers_nothing_is_said() -> None:
    for watch in (BatteryWatch(SIX_CELLS), watched((math.nan, math.nan), config=SIX_CELLS)):
        assert (watch.low, watch.empty) == (None, None)


def test_a_voltage_that_sags_while_the_motors_start_is_no_low_battery() -> None:
    sagging = [(math.nan, 24.0), (math.nan, 18.0)] * 5
    watch = watched(*sagging, config=SIX_CELLS, seconds=math.floor(LASTING_S))
    assert (watch.low, watch.empty) == (None, None)


def test_another_battery_ends_the_warning() -> None:
    assert watched((0.1, 20.0), (0.9, 25.0)).low is None


def running_down(gate: Gate, charge_ratio: float) -> SensorBatch:
    t_s = gate.rover.t_s + TICK_S
    return msgspec.structs.replace(
        gate.rover.batch(), t_s=t_s, battery=(sample(t_s, charge_ratio),)
    )


def test_an_empty_battery_stops_the_mission_and_lets_a_hand_drive_after_a_clear() -> None:
    gate = Gate()
    for _ in range(300):
        sent, reason = gate.send(batch=running_down(gate, 0.15))
    assert (sent.drive.v_mps, reason) == (0.4, None)
    assert gate.supervisor.warning
    for _ in range(300):
        sent, reason = gate.send(batch=running_down(gate, 0.05))
    assert_stopped(sent, reason, StopToClear(BatteryEmpty(5.0, 8.0)))
    gate.send(STOP, state="paused", actions=("clear_stop",))
    for _ in range(50):
        sent, reason = gate.send(AHEAD, state="paused", is_by_hand=True)
    assert (sent.drive, reason) == (AHEAD, None)
    assert_stopped(*gate.send(batch=running_down(gate, 0.05)), BatteryEmpty)


def test_a_low_battery_sends_the_robot_home_once() -> None:
    one = ride()
    one.settle()
    one.along(0.0, 3.0)
    place = one.place(3.0)
    one.mission.obey_warning(low(19.0))
    for _ in range(3):
        goal = one.be_at(*place)
        one.mission.obey_warning(low(18.0))
    assert (goal.status.state, goal.status.leg) == ("running", "way home")
    assert goal.status.warning_fact == low(18.0)
    assert not goal.tool_on
    one.be_at(*place, "pause")
    one.mission.obey_warning(low(17.0))
    assert one.be_at(*place).status.state == "paused", "a person decides from now on"
    one.mission.obey_warning(None)
    assert one.be_at(*place).status.warning_fact is None


@pytest.mark.parametrize("words", [("pause",), ("stop", "clear_stop")])
def test_a_battery_that_gets_low_while_the_robot_stands_sends_it_home_once_it_is_resumed(
    words: tuple[str, ...],
) -> None:
    one = ride()
    one.settle()
    one.along(0.0, 3.0)
    place = one.place(3.0)
    for word in words:
        one.be_at(*place, word)
    for _ in range(10):
        one.mission.obey_warning(low(19.0))
        assert one.be_at(*place).status.state == "paused"
    one.be_at(*place, "resume")
    for _ in range(3):
        one.mission.obey_warning(low(18.0))
        status = one.be_at(*place).status
    assert (status.state, status.leg) == ("running", "way home")
    one.be_at(*place, "pause")
    one.be_at(*place, "resume")
    for _ in range(3):
        one.mission.obey_warning(low(17.0))
        assert one.be_at(*place).status.refusal_fact is None


def test_a_battery_that_gets_low_while_the_robot_stops_for_a_goal_is_heeded_too() -> None:
    drive = Drive()
    place = drive.into_row(1)
    assert drive.goto(place, *HEADLAND, v_mps=0.2).status.leg == STOPPING
    for _ in range(5):
        drive.mission.obey_warning(low(19.0))
        status = drive.be_at(*place).status
    assert (status.state, status.leg) == ("running", "way home")


def test_a_battery_whose_way_home_cannot_be_planned_holds_the_robot_and_says_so() -> None:
    def no_way(*_: object) -> Path:
        raise MissionError(Said("a post stands in the way"))

    one = Ride(Mission(PaperTask(plan, ROWS, home=no_way), MISSION))
    one.settle()
    one.along(0.0, 3.0)
    for _ in range(20):
        one.mission.obey_warning(low(19.0))
        status = one.be_at(*one.place(3.0)).status
    assert status.state == "paused"
    why = Both(low(19.0), ErrandRefused("charge", Said("a post stands in the way")))
    assert (status.fact, status.held_fact) == (why, why)


def test_without_a_way_home_a_low_battery_stops_the_robot_where_it_is() -> None:
    one = Ride(Mission(PaperTask(plan, ROWS), MISSION))
    one.settle()
    one.along(0.0, 3.0)
    one.mission.obey_warning(low(19.0))
    status = one.be_at(*one.place(3.0)).status
    assert status.state == "paused"
    assert isinstance(status.fact, Both) and status.fact.first == low(19.0)
    assert status.fact.second == ErrandRefused("home", OwnPathOnly())


def test_a_low_battery_stands_in_the_event_log_once() -> None:
    sieve, found = EventSieve(), []
    for k, warning in enumerate([None, low(19.0), low(18.0), None]):
        record = record_samples.tick(k, np.random.default_rng(0))
        status = msgspec.structs.replace(
            record.status, warning=render(warning), warning_fact=warning
        )
        found += [event for event in sieve(msgspec.structs.replace(record, status=status))
                  if "battery" in event.parts]  # fmt: skip
    assert [event.kind for event in found] == ["fault", "clear"]
