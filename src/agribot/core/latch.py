"""The latched stop that holds a robot until a person clears it."""

from __future__ import annotations

from agribot.core.messages import OperatorEvent


class Latch:
    """Says why the robot stands; empty while it may move.

    Whoever hears the events of a tick may pass them on: hearing the same ones twice changes
    nothing. A second reason does not hide the first.
    """

    def __init__(self, reason: str = "") -> None:
        self.reason = reason

    def hear(self, event: OperatorEvent) -> None:
        """Anybody's stop closes the latch; nothing but `clear_stop` opens it.

        The text of a stop says why it stands, where whose it is says too little.
        """
        if event.action == "stop":
            self.hold(event.text or f"stopped by {event.source}")
        elif event.action == "clear_stop":
            self.reason = ""

    def hold(self, reason: str) -> None:
        self.reason = self.reason or reason
