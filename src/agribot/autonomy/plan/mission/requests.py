"""What a mission does with every request in each of its states: the one table.

Whatever a person or a program may ask stands here for every state: it is done, refused with a
reason, or left alone for a reason. `docs/mission.md` shows the table.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Literal, NamedTuple

from agribot.autonomy.plan.mission.states import (
    Driving,
    Ended,
    OnErrand,
    Paused,
    State,
    Stopping,
    Waiting,
)
from agribot.core.facts import (
    AnyFact,
    AwayFromRows,
    ErrandRefused,
    InNoRow,
    MissionEnded,
    NothingPlanned,
    NotResumed,
    NotStarted,
    RowNotMoved,
    RowNotSkipped,
    StopHolds,
    TaskRefused,
)
from agribot.core.messages import RequestWord


class Do(Enum):
    """The mission acts, in words for people. It may still refuse: there is no way home."""

    HOLD = "stops until it is released"
    RELEASE = "is released, waits for resume"
    PAUSE = "pauses"
    RESUME = "goes on where it was"
    BEGIN_ANEW = "begins once more from here"
    CANCEL = "ends as cancelled"
    SKIP_ROW = "leaves out the row"
    TURN_HOME = "stops, then drives home"
    TURN_TO_GOAL = "stops, then drives there"
    TAKE_PLAN = "takes it as its task when it stands"
    TAKE_VISIT = "goes there from here as its task"
    NUDGE_LEFT = "moves the line of its row 1 cm to the left"
    NUDGE_RIGHT = "moves the line of its row 1 cm to the right"
    SET = "takes the new speed"


class Refuse(NamedTuple):
    """The request is refused; the status states why."""

    why: AnyFact


class Ignore(NamedTuple):
    """The request needs no action, and why that is no refusal."""

    why: str


Reaction = Do | Refuse | Ignore


# `stopped` counts while a stop holds the robot, before its state, unless it has ended for good;
# where it is not given, the state counts. `ended` has ended for good, `open` still takes requests.
Column = Literal[
    "waiting", "driving", "on_errand", "stopping", "paused", "ended", "open", "stopped"
]  # fmt: skip
COLUMN_OF: Mapping[type[State], Column] = {
    Waiting: "waiting",
    Driving: "driving",
    OnErrand: "on_errand",
    Stopping: "stopping",
    Paused: "paused",
    Ended: "ended",
}


def _until_ended(reaction: Reaction) -> dict[Column, Reaction]:
    return dict.fromkeys(("waiting", "driving", "on_errand", "stopping", "paused"), reaction)


def _always(reaction: Reaction) -> dict[Column, Reaction]:
    return {**_until_ended(reaction), "ended": reaction, "open": reaction}


_STANDS = Ignore("it stands already")
_DRIVES = Ignore("it drives already")
_SETS_OFF = Ignore("it sets off by itself")
_OVER = Ignore("it has ended already")
_RECORDED = Ignore("the recording takes it")
_NO_ROW = Refuse(RowNotMoved(InNoRow()))

TABLE: Mapping[RequestWord, Mapping[Column, Reaction]] = {
    "stop": _always(Do.HOLD),
    "clear_stop": _always(Do.RELEASE),
    "start": {
        "waiting": _SETS_OFF,
        "driving": _DRIVES,
        "on_errand": _DRIVES,
        "stopping": _SETS_OFF,
        "paused": Do.RESUME,
        "ended": Refuse(NotStarted(MissionEnded())),
        "open": Do.BEGIN_ANEW,
        "stopped": Refuse(NotStarted(StopHolds())),
    },
    "resume": {
        "waiting": _SETS_OFF,
        "driving": _DRIVES,
        "on_errand": _DRIVES,
        "stopping": _SETS_OFF,
        "paused": Do.RESUME,
        "ended": Refuse(NotResumed(MissionEnded())),
        "open": Refuse(NotResumed(MissionEnded(can_start=True))),
        "stopped": Refuse(NotResumed(StopHolds())),
    },
    "pause": {
        **_until_ended(Do.PAUSE),
        "ended": _STANDS,
        "open": _STANDS,
        "stopped": _STANDS,
    },
    "cancel": {**_until_ended(Do.CANCEL), "ended": _OVER, "open": _OVER},
    "skip_row": {
        "waiting": Refuse(RowNotSkipped(NothingPlanned())),
        "driving": Do.SKIP_ROW,
        "on_errand": Refuse(RowNotSkipped(AwayFromRows())),
        "stopping": Do.SKIP_ROW,
        "paused": Do.SKIP_ROW,
        "ended": Refuse(RowNotSkipped(MissionEnded())),
        "open": Refuse(RowNotSkipped(MissionEnded())),
    },
    "nudge_left": {**_always(_NO_ROW), "driving": Do.NUDGE_LEFT, "paused": Do.NUDGE_LEFT},
    "nudge_right": {**_always(_NO_ROW), "driving": Do.NUDGE_RIGHT, "paused": Do.NUDGE_RIGHT},
    "return_home": {
        **_always(Do.TURN_HOME),
        "ended": Refuse(ErrandRefused("home", MissionEnded())),
        "stopped": Refuse(ErrandRefused("home", StopHolds())),
    },
    "goto": {
        **_always(Do.TURN_TO_GOAL),
        "ended": Refuse(ErrandRefused("goal", MissionEnded())),
        "stopped": Refuse(ErrandRefused("goal", StopHolds())),
    },
    "visit": {**_always(Do.TAKE_VISIT), "ended": Refuse(TaskRefused("visit", MissionEnded()))},
    "plan": {**_always(Do.TAKE_PLAN), "ended": Refuse(TaskRefused("plan", MissionEnded()))},
    "set": {**_always(Do.SET), "ended": Ignore("it drives nowhere any more")},
    "pose_estimate": _always(Ignore("the estimate takes it")),
    "note": _always(_RECORDED),
    "mark": _always(_RECORDED),
    "point_out": _always(_RECORDED),
    "draw_polygon": _always(_RECORDED),
    "draw_route": _always(_RECORDED),
    "start_recording": _always(_RECORDED),
    "stop_recording": _always(_RECORDED),
}


def react(word: RequestWord, state: State, *, is_stopped: bool, stays_open: bool) -> Reaction:
    """Look up what to do; `stays_open` says that a mission takes requests after its end, too."""
    reactions, column = TABLE[word], COLUMN_OF[type(state)]
    if column == "ended" and not stays_open:
        return reactions["ended"]
    if is_stopped and "stopped" in reactions:
        return reactions["stopped"]
    return reactions["open" if column == "ended" else column]
