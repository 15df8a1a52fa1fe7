"""The latched stop that holds a robot until a person clears it."""

from __future__ import annotations

from agribot.core.facts import Fact, Said, StoppedBy
from agribot.core.messages import OperatorEvent


class Latch:
    """Holds why the robot stands; `cause` is None while it may move.

    A part may pass on the events of a tick that it gets: the same ones twice change nothing. A
    second cause does not hide the first.
    """

    def __init__(self) -> None:
        self.cause: Fact | None = None

    def hear(self, event: OperatorEvent) -> None:
        """Take requests: any stop closes the latch; nothing but `clear_stop` opens it.

        The text of a stop says why it stands, where whose it is says too little.
        """
        if event.action == "stop":
            said = Said(event.text, event.source) if event.text else StoppedBy(event.source)
            self.hold(event.fact or said)
        elif event.action == "clear_stop":
            self.cause = None

    def hold(self, cause: Fact) -> None:
        self.cause = self.cause or cause
