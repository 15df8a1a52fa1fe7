"""States of the robot in which a fault begins, and what people do so that it gets into them.

A script is what a person does in a drive, a generator that gets each tick. A state is reached
some time after a tick of its script; that is an event of the drive and no time of a clock.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import NamedTuple

from agribot.core.messages import (
    ClearStop,
    ControlMission,
    GoTo,
    Inbox,
    MissionAction,
    PressStop,
    TickRecord,
)

TICK_HZ = 50.0
# Time in the row before a person acts, until the drive goes on, and of each way by hand, s.
IN_ROW_S, STANDS_S, BY_HAND_S = 4.0, 15.0, 6.0
HAND_MPS = 0.2
# A place on the headland beside the start, m.
AWAY_MAP_M = (-1.4, 1.2)
TURNING_RADPS = 0.15
STANDING_MPS = 0.02
ENDED = ("done", "cancelled", "failed")

Waiting = Generator[None, TickRecord, None]
Test = Callable[[TickRecord], bool]
Script = Callable[[Inbox], Waiting]


class CellState(NamedTuple):
    """A state: the script that leads to it, the tick that reaches it, and the time from there on.

    `is_reached` None is the time 0.
    """

    name: str
    script: str
    is_reached: Test | None
    later_s: float = 0.0


def wait_for(is_reached: Test, later_s: float = 0.0) -> Waiting:
    """Wait until a tick of this kind, and some time after it."""
    record = yield
    while not is_reached(record):
        record = yield
    yield from wait(later_s)


def wait(seconds: float) -> Waiting:
    """Wait for this time by ticks: the clock of the robot may jump."""
    for _ in range(round(seconds * TICK_HZ)):
        yield


def _is_before_row(record: TickRecord) -> bool:
    return record.status.leg == "to row 1"


def _is_in_row(record: TickRecord) -> bool:
    return record.status.state == "running" and record.status.row == 0


def _is_after_row(record: TickRecord) -> bool:
    return record.status.state == "running" and record.status.leg == "to row 2"


def _is_turning(record: TickRecord) -> bool:
    return _is_after_row(record) and abs(record.estimate.yaw_rate_radps) > TURNING_RADPS


def _stands(record: TickRecord) -> bool:
    return abs(record.estimate.v_mps) < STANDING_MPS


def _is_paused(record: TickRecord) -> bool:
    return record.status.state == "paused" and _stands(record)


def _is_stopped(record: TickRecord) -> bool:
    return bool(record.status.stopped) and _stands(record)


def _has_ended(record: TickRecord) -> bool:
    return record.status.state in ENDED and _stands(record)


def _do(inbox: Inbox, action: MissionAction) -> None:
    inbox.post(ControlMission(action=action))


def watch_only(_inbox: Inbox) -> Waiting:
    """Do nothing."""
    yield from ()


def _pause(inbox: Inbox) -> Waiting:
    yield from wait_for(_is_in_row, IN_ROW_S)
    _do(inbox, "pause")
    yield from wait(STANDS_S)
    _do(inbox, "resume")


def _press_stop(inbox: Inbox) -> Waiting:
    yield from wait_for(_is_in_row, IN_ROW_S)
    inbox.post(PressStop())
    yield from wait(STANDS_S)
    inbox.post(ClearStop())
    yield from wait(1.0)
    _do(inbox, "resume")


def _drive_by_hand(inbox: Inbox) -> Waiting:
    yield from wait_for(_is_in_row, IN_ROW_S)
    _do(inbox, "pause")
    yield from wait(1.0)
    for v_mps in (HAND_MPS, -HAND_MPS):
        for _ in range(round(BY_HAND_S * TICK_HZ)):
            inbox.drive(v_mps, 0.0)
            yield
    yield from wait(1.0)
    _do(inbox, "resume")


def _send_away(inbox: Inbox) -> Waiting:
    yield from wait_for(_is_before_row, 1.0)
    inbox.post(GoTo(x_map_m=AWAY_MAP_M[0], y_map_m=AWAY_MAP_M[1]))
    yield from wait_for(lambda record: record.status.leg == "to the goal")
    yield from wait_for(_is_paused, 2.0)
    _do(inbox, "resume")


PLAIN, KILLED = "plain", "killed"
# Actions of a person by script. In `killed` the program is killed and started again.
SCRIPTS: dict[str, Script] = {
    PLAIN: watch_only,
    "pause": _pause,
    "stop": _press_stop,
    "hand": _drive_by_hand,
    "errand": _send_away,
    KILLED: watch_only,
}
STATES = (
    CellState("before the start", PLAIN, None),
    CellState("waiting", PLAIN, lambda record: record.status.state == "waiting", 1.0),
    CellState("start", PLAIN, _is_before_row, 0.5),
    CellState("straight", PLAIN, _is_in_row, 5.0),
    CellState("headland", PLAIN, _is_after_row, 0.5),
    CellState("turn", PLAIN, _is_turning, 1.0),
    CellState("paused", "pause", _is_paused, 4.0),
    CellState("stopped", "stop", _is_stopped, 4.0),
    CellState("by hand", "hand", lambda record: record.status.gate.state == "by hand", 2.0),
    CellState("errand", "errand", lambda record: record.status.leg == "to the goal", 1.5),
    CellState("resumed", KILLED, lambda record: record.status.state == "running", 2.0),
    CellState("end", PLAIN, _has_ended, 3.0),
)
STATE_OF = {state.name: state for state in STATES}


class Person:
    """What a person does in a drive: call it with every tick."""

    def __init__(self, waiting: Waiting) -> None:
        self._waiting = waiting
        self.is_done = next(waiting, True) is True

    def __call__(self, record: TickRecord) -> None:
        if self.is_done:
            return
        try:
            self._waiting.send(record)
        except StopIteration:
            self.is_done = True


class Onsets:
    """Notes when a drive reaches each state of its script: call it with every tick."""

    def __init__(self, script: str) -> None:
        mine = [state for state in STATES if state.script == script]
        self.found_s = {state.name: 0.0 for state in mine if state.is_reached is None}
        self._awaited = {
            state.name: Person(wait_for(state.is_reached, state.later_s))
            for state in mine
            if state.is_reached is not None
        }

    def __call__(self, record: TickRecord, t_s: float) -> None:
        """Take in a tick at a time on the clock of the job."""
        for name, awaited in self._awaited.items():
            awaited(record)
            if awaited.is_done:
                self.found_s.setdefault(name, round(t_s, 3))
