"""The inbox for what people and other programs ask of a running robot, and how a hand drives it."""

from __future__ import annotations

from collections import deque
from typing import TypeVar

import msgspec

from agribot.core.messages.requests import AnyRequest, PressStop, RequestEvent, StopFor, Who

T = TypeVar("T")

INBOX_LIMIT = 1000  # requests between two ticks; a flood loses its oldest, but never a stop
OPERATOR = Who()


class HandDrive(msgspec.Struct, frozen=True, kw_only=True):
    """A body twist by hand. It holds only for a moment: a client that drives keeps sending it."""

    t_s: float
    v_mps: float
    yaw_rate_radps: float
    who: Who = OPERATOR


class Inbox:
    """A thread-safe queue of requests: any thread posts, the platform drains it.

    Of drive requests only the newest counts, and none where `takes_hands` is false. Stops are kept
    apart, so that no flood of other requests can push one out.
    """

    takes_hands = True

    def __init__(self) -> None:
        self._stops: deque[RequestEvent] = deque(maxlen=INBOX_LIMIT)
        self._events: deque[RequestEvent] = deque(maxlen=INBOX_LIMIT)
        self._hand: deque[HandDrive] = deque(maxlen=1)

    def post(self, request: AnyRequest, who: Who = OPERATOR) -> None:
        queue = self._stops if isinstance(request, PressStop | StopFor) else self._events
        queue.append(RequestEvent(t_s=0.0, who=who, request=request))

    def drive(self, v_mps: float, yaw_rate_radps: float, who: Who = OPERATOR) -> None:
        """Request a twist; the supervisor refuses numbers that are not finite."""
        self._hand.append(HandDrive(t_s=0.0, v_mps=v_mps, yaw_rate_radps=yaw_rate_radps, who=who))

    def drain(self, t_s: float) -> tuple[tuple[RequestEvent, ...], tuple[HandDrive, ...]]:
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
