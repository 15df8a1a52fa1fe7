"""Faults that the motor board reports stop the robot, and so does its silence."""

from __future__ import annotations

from unittest.mock import ANY

import msgspec
import pytest

from agribot.autonomy.control.hazards import OF_BOARD
from agribot.core.config import SafetyConfig
from agribot.core.facts import (
    BoardHoldsStop,
    BoardHung,
    BoardReports,
    BoardStopped,
    ButtonPressed,
    InputNotHeardYet,
    InputSilent,
    StopToClear,
)
from agribot.core.messages import STOP, BoardSample, SafetyInput, SensorBatch
from tests.autonomy.control.kinematic_rover import TICK_S
from tests.autonomy.control.test_supervisor import FORWARD, Gate, assert_stopped
from tests.finding import holds

ALL: tuple[SafetyInput, ...] = ("red button", "bumper", "battery", "motors")
BEGAN, BUTTON = BoardStopped(("began",)), BoardStopped(("button",))


def telling(gate: Gate, **changes: object) -> SensorBatch:
    """The batch of the next tick, with the board's report in it."""
    t_s = gate.rover.t_s + TICK_S
    sample = msgspec.structs.replace(BoardSample(t_s=t_s, inputs=ALL), **changes)
    wheels = gate.rover.batch()
    return msgspec.structs.replace(wheels, t_s=t_s, board=(sample,))


def cruising(config: SafetyConfig | None = None) -> Gate:
    gate = Gate(config)
    for _ in range(50):
        sent, reason = gate.send(batch=telling(gate))
    assert (sent.drive, reason) == (FORWARD, None)
    return gate


@pytest.mark.parametrize("state", ["running", "waiting"])
def test_the_red_button_stops_a_robot_that_drives_and_holds_one_that_stands(state: str) -> None:
    gate = cruising()
    pressed = telling(gate, is_button_pressed=True, stop=BUTTON)
    gate.send(STOP if state == "waiting" else FORWARD, batch=pressed, state=state)  # type: ignore[arg-type]
    assert_stopped(*gate.send(batch=telling(gate)), StopToClear(ButtonPressed()))
    pressed = telling(gate, is_button_pressed=True, stop=BUTTON)
    gate.send(STOP, state="paused", batch=pressed, actions=("clear_stop",))
    sent, reason = gate.send(batch=telling(gate, is_button_pressed=True, stop=BUTTON))
    assert_stopped(sent, reason, ButtonPressed)


def test_a_board_has_a_moment_to_let_go_of_the_stop_that_a_person_cleared_and_no_second_one() -> (
    None
):
    gate = cruising()
    gate.send(batch=telling(gate, stop=BEGAN))
    assert gate.supervisor.gate.fact == BoardHoldsStop(cause=BEGAN)
    held = telling(gate, stop=BEGAN)
    gate.send(STOP, state="paused", batch=held, actions=("clear_stop",))
    for _ in range(50):
        sent, reason = gate.send(batch=telling(gate, stop=BEGAN))
        assert reason is None
    sent, _ = gate.send(batch=telling(gate))
    assert sent.drive == FORWARD
    sent, reason = gate.send(batch=telling(gate, stop=BEGAN))
    assert_stopped(sent, reason, BoardHoldsStop(cause=BEGAN))


def test_a_board_that_never_lets_go_stops_the_robot_again() -> None:
    gate = cruising()
    gate.send(STOP, state="paused", batch=telling(gate, stop=BEGAN), actions=("clear_stop",))
    reasons = {gate.send(batch=telling(gate, stop=BEGAN))[1] for _ in range(200)}
    assert any(holds(reason, BoardHoldsStop(cause=BEGAN)) for reason in reasons)


def test_a_fault_of_the_board_stops_the_robot_and_lets_a_hand_drive_it_off() -> None:
    gate = cruising()
    faulty = telling(gate, fault=BoardHung())
    assert_stopped(*gate.send(batch=faulty), BoardReports(cause=BoardHung()))
    gate.send(STOP, state="paused", batch=telling(gate, fault=BoardHung()),
              actions=("clear_stop",))  # fmt: skip
    batch = telling(gate, fault=BoardHung())
    sent, _ = gate.send(FORWARD, state="paused", batch=batch, is_by_hand=True)
    assert sent.drive != STOP
    assert_stopped(*gate.send(batch=telling(gate, fault=BoardHung())), BoardHung)


@pytest.mark.parametrize(("name", "limit_s"), [("red button", 0.3), ("battery", 5.0)])
def test_an_input_that_the_robot_must_have_stops_it_when_it_grows_old(
    name: str, limit_s: float
) -> None:
    gate = cruising(SafetyConfig(must_report=("red button", "battery")))
    rest = tuple(one for one in ALL if one != name)
    ticks = 0
    for _ in range(400):
        sent, reason = gate.send(batch=telling(gate, inputs=rest))
        if reason:
            break
        ticks += 1
    assert_stopped(sent, reason, InputSilent(name, ANY, limit_s))
    assert ticks * TICK_S == pytest.approx(limit_s, abs=3 * TICK_S)
    for _ in range(20):  # it is back, and the stop stays
        assert_stopped(*gate.send(batch=telling(gate)), StopToClear)


def test_an_input_that_never_spoke_holds_the_start_with_its_item_of_the_list() -> None:
    gate = Gate(SafetyConfig(must_report=("red button",)))
    sent, reason = gate.send()
    assert_stopped(sent, reason, InputNotHeardYet("red button"))
    assert gate.supervisor.gate.state == "checking"
    bad = [check.name for check in gate.supervisor.gate.checks if not check.is_ok]
    assert bad == ["safety inputs"]
    for _ in range(50):
        sent, reason = gate.send(batch=telling(gate))
    assert (sent.drive, reason) == (FORWARD, None)


def test_a_robot_without_such_a_board_is_not_held_and_its_list_is_silent_of_it() -> None:
    gate = Gate()
    gate.send(STOP, state="waiting")
    gate.send()
    listed = [check.name for check in gate.supervisor.gate.checks]
    assert "bumper" in listed
    assert not {*OF_BOARD} & {*listed}
    gate.cruise()
