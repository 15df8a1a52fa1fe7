"""What the mission makes of a request: asked in the page's threads, answered by the next ticks."""

from __future__ import annotations

import threading

import msgspec

from agribot.autonomy.plan.errand import CHECKING, STOPPING
from agribot.core.messages import Inbox, OperatorEvent, TickRecord

PATIENCE_S = 4.0  # the page itself waits a little longer


class _Asked:
    def __init__(self, event: OperatorEvent) -> None:
        self.event = event
        self.is_heard = False
        self.refusal = ""
        self.is_settled = threading.Event()


class Verdicts:
    """A tap; `ask` may be called in any thread but the robot's."""

    def __init__(self, inbox: Inbox) -> None:
        self._inbox = inbox
        self._asked: list[_Asked] = []

    def __call__(self, record: TickRecord) -> None:
        for asked in tuple(self._asked):  # other threads add to it and take from it
            told = (msgspec.structs.replace(event, t_s=0.0) for event in record.batch.events)
            asked.is_heard = asked.is_heard or asked.event in told
            if asked.is_heard and record.status.leg not in (CHECKING, STOPPING):
                asked.refusal = record.status.refusal
                asked.is_settled.set()

    def ask(self, event: OperatorEvent) -> str:
        """Post a request; why it is refused, or nothing.

        A goal that takes long to settle counts as taken: the robot still rolls out, and what
        becomes of it is told by the mission's state.
        """
        asked = _Asked(event)
        self._asked.append(asked)
        self._inbox.post(event)
        is_settled = asked.is_settled.wait(PATIENCE_S)
        self._asked.remove(asked)
        if is_settled or (asked.is_heard and event.action == "goto"):
            return asked.refusal
        return f"the robot did not answer within {PATIENCE_S:g} s; see whether its ticks arrive"
