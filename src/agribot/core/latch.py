"""The latched stop that holds a robot until a person clears it."""

from __future__ import annotations

from agribot.core.facts import Fact, StoppedBy
from agribot.core.messages import ClearStop, PressStop, RequestEvent, StopFor


class Latch:
    """Holds why the robot stands; `cause` is None while it may move.

    A part may pass on the events of a tick that it gets: the same ones twice change nothing. A
    second cause does not hide the first.
    """

    def __init__(self) -> None:
        self.cause: Fact | None = None

    def hear(self, event: RequestEvent) -> None:
        """Close it for anybody's stop; only a request to clear it opens it."""
        match event.request:
            case PressStop():
                self.hold(StoppedBy(event.who.name))
            case StopFor(cause=cause):
                self.hold(cause)
            case ClearStop():
                self.cause = None

    def hold(self, cause: Fact) -> None:
        self.cause = self.cause or cause
