"""What people and other programs ask of a running robot, and the inbox that takes it."""

from __future__ import annotations

from collections import deque
from typing import Literal, TypeVar

import msgspec

from agribot.core.facts import AnyFact, Part

T = TypeVar("T")

# "start" restarts a mission that has ended and resumes one that is paused.
# A note changes nothing: it is text that a person or a page adds to the recording.
# "sensor" is not sent by operators: what watches a sensor reports in `text` that it is at fault
# (`value` 1), or fine again (0).
# "set" changes one of LIVE_SETTINGS, named in `text`, to `value`.
# "pose_estimate" gives a standing robot its pose in `numbers`: x and y (m, map), yaw (rad),
# and 1 sigma of the place (m) and of the yaw (rad).
# "goto" sends the robot to the place in `numbers`: x, y (m, map) and, where it matters, yaw (rad).
# "visit" makes places its mission, x and y (m, map) of each in `numbers`; `text` is its name.
# "plan" gives a standing robot the field plan in `text` (GeoJSON) as its new mission.
# "nudge_left" and "nudge_right" move the line of the row under the robot aside, a step each.
# "point_out", "draw_polygon" and "draw_route" are for programs that listen to the robot's topics:
# places that a person showed on the map, x and y (m, map) of each in `numbers`; `text` says it in
# words.
# "mark" marks this moment in the recording with `text`; the two of recording begin and end one.
OperatorAction = Literal[
    "start", "pause", "resume", "cancel", "stop", "clear_stop", "skip_row", "return_home", "note",
    "set", "pose_estimate", "goto", "visit", "plan", "mark", "start_recording", "stop_recording",
    "nudge_left", "nudge_right", "sensor", "point_out", "draw_polygon", "draw_route",
]  # fmt: skip
LIVE_SETTINGS = ("mission.speed_mps", "treatment.enabled")

SENSOR_WATCH = "sensors"  # shown as the source of the notes on sensors
INBOX_LIMIT = 1000  # requests between two ticks; a flood loses its oldest, but never a stop


class OperatorEvent(msgspec.Struct, frozen=True, kw_only=True):
    """A request to the robot; what `text`, `value` and `numbers` mean depends on the action.

    The part that judges it answers by its `id`, if it has one.
    """

    t_s: float
    action: OperatorAction
    source: str = "operator"
    text: str = ""
    value: float = 0.0
    numbers: tuple[float, ...] = ()
    id: str = ""
    parts: tuple[Part, ...] = ()  # parts that a note on a sensor is about
    fact: AnyFact | None = None  # why the program itself asks for a stop; `text` is its text


def make_sensor_note(
    t_s: float, text: str, *, is_fault: bool, parts: tuple[Part, ...] = ()
) -> OperatorEvent:
    """Make the note of a fault of a sensor or its line, or that it is over."""
    value = float(is_fault)
    return OperatorEvent(
        t_s=t_s, action="sensor", source=SENSOR_WATCH, text=text, value=value, parts=parts
    )


class HandDrive(msgspec.Struct, frozen=True, kw_only=True):
    """A body twist by hand. It holds only for a moment: a client that drives keeps sending it."""

    t_s: float
    v_mps: float
    yaw_rate_radps: float
    source: str = "operator"


class Inbox:
    """A thread-safe queue of requests: any thread posts, the platform drains it.

    Stamps given by the sender are dropped. Of drive requests only the newest counts, and none
    where `takes_hands` is false. Stops are kept apart, so that no flood of other requests can push
    one out.
    """

    takes_hands = True

    def __init__(self) -> None:
        self._stops: deque[OperatorEvent] = deque(maxlen=INBOX_LIMIT)
        self._events: deque[OperatorEvent] = deque(maxlen=INBOX_LIMIT)
        self._hand: deque[HandDrive] = deque(maxlen=1)

    def post(self, event: OperatorEvent) -> None:
        (self._stops if event.action == "stop" else self._events).append(event)

    def drive(self, v_mps: float, yaw_rate_radps: float, source: str) -> None:
        """Request a twist; the supervisor refuses numbers that are not finite."""
        self._hand.append(
            HandDrive(t_s=0.0, v_mps=v_mps, yaw_rate_radps=yaw_rate_radps, source=source)
        )

    def drain(self, t_s: float) -> tuple[tuple[OperatorEvent, ...], tuple[HandDrive, ...]]:
        """Take the requests since the last call, stamped `t_s`; stops come last and so win."""
        if not (self._stops or self._events or self._hand):
            return (), ()
        events = [*_empty_queue(self._events), *_empty_queue(self._stops)]
        hands = _empty_queue(self._hand)
        return (
            tuple(msgspec.structs.replace(event, t_s=t_s) for event in events),
            tuple(msgspec.structs.replace(hand, t_s=t_s) for hand in hands if self.takes_hands),
        )


def _empty_queue(queue: deque[T]) -> list[T]:
    """Empty the queue while others may still append to it."""
    taken = []
    while queue:
        taken.append(queue.popleft())
    return taken
