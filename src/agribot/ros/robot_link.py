"""What a running robot makes of requests: what its mission answers, and where it stands."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable

import msgspec

from agribot.core.messages import Inbox, OperatorEvent, TickRecord

PATIENCE_S = 4.0
_MOST_OPEN = 100  # requests without an answer; the oldest is forgotten

# Gets the refusal, or "", and the record of the tick; called in the robot's thread.
OnAnswer = Callable[[str, TickRecord], None]


class RobotLink:
    """A tap of the run; requests may come from any thread.

    `record` is the newest tick, None before the first one.
    """

    def __init__(self, inbox: Inbox) -> None:
        self._inbox = inbox
        self._lock = threading.Lock()
        self._numbers = itertools.count(1)
        self._open: dict[str, OnAnswer] = {}
        self.record: TickRecord | None = None

    def __call__(self, record: TickRecord) -> None:
        self.record = record
        for answer in record.status.answers:
            with self._lock:
                on_answer = self._open.pop(answer.id, None)
            if on_answer is not None:
                on_answer(answer.refusal, record)

    def post(self, event: OperatorEvent, on_answer: OnAnswer) -> None:
        """Post a request; `on_answer` is called once, when the mission took or refused it."""
        with self._lock:
            key = f"peer-{next(self._numbers)}"
            while len(self._open) >= _MOST_OPEN:
                self._open.pop(next(iter(self._open)))
            self._open[key] = on_answer
        self._inbox.post(msgspec.structs.replace(event, id=key))

    def ask(self, event: OperatorEvent) -> tuple[bool, str]:
        """Post a request and wait; return whether it was taken, and the text for the peer."""
        settled = threading.Event()
        found: list[tuple[str, TickRecord]] = []

        def on_answer(refusal: str, record: TickRecord) -> None:
            found.append((refusal, record))
            settled.set()

        self.post(event, on_answer)
        if not settled.wait(PATIENCE_S):
            return False, (
                f"'{event.action}' was handed to the robot, which did not answer within "
                f"{PATIENCE_S:g} s; see whether its ticks arrive"
            )
        refusal, record = found[0]
        if refusal:
            return False, refusal
        state, reason = record.status.state, record.status.reason
        return True, f"'{event.action}' is taken; the mission is {state}" + (
            f": {reason}" if reason else ""
        )
