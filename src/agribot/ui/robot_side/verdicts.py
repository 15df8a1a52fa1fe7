"""What the mission makes of a request: asked in the page's threads, answered by the next ticks."""

from __future__ import annotations

import itertools
import threading

import msgspec

from agribot.core.facts import AnyFact, NoAnswer
from agribot.core.messages import AnyRequest, GoTo, Inbox, TickRecord, Who

PATIENCE_S = 4.0  # the page itself waits a little longer


class _Asked:
    def __init__(self) -> None:
        self.is_heard = False
        self.refusal: AnyFact | None = None
        self.is_settled = threading.Event()


class Verdicts:
    """A tap; `ask` may be called in any thread but the robot's.

    Each request goes out with an id of its own, which the mission's answer to it carries.
    """

    def __init__(self, inbox: Inbox) -> None:
        self._inbox = inbox
        self._numbers = itertools.count(1)
        self._asked: dict[str, _Asked] = {}

    def __call__(self, record: TickRecord) -> None:
        for event in record.batch.requests:
            if asked := self._asked.get(event.request.id):
                asked.is_heard = True
        for answer in record.status.answers:
            if asked := self._asked.get(answer.id):
                asked.refusal = answer.fact
                asked.is_settled.set()

    def ask(self, request: AnyRequest, who: Who) -> AnyFact | None:
        """Post a request; return why it is refused, or None.

        A goal that takes long to settle counts as taken: the robot still rolls out, and the
        mission's state shows what becomes of it.
        """
        id = f"page-{next(self._numbers)}"
        asked = self._asked[id] = _Asked()
        self._inbox.post(msgspec.structs.replace(request, id=id), who)
        is_settled = asked.is_settled.wait(PATIENCE_S)
        del self._asked[id]
        if is_settled or (asked.is_heard and isinstance(request, GoTo)):
            return asked.refusal
        return NoAnswer(PATIENCE_S)
