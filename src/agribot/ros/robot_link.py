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
OnOutcome = Callable[[bool, str], None]  # gets whether it was taken, and the text for the peer


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

    def ask(self, event: OperatorEvent, on_outcome: OnOutcome) -> None:
        """Post a request; call `on_outcome` once, at the latest when patience ends."""
        asked = _Asked(event, on_outcome)
        self.post(event, asked.settle)
        asked.timer.start()


class _Asked:
    """Whatever comes first counts: the mission's answer, or the end of patience."""

    def __init__(self, event: OperatorEvent, on_outcome: OnOutcome) -> None:
        self._event, self._on_outcome = event, on_outcome
        self._first = threading.Semaphore()
        self.timer = threading.Timer(PATIENCE_S, self._give_up)
        self.timer.daemon = True

    def settle(self, refusal: str, record: TickRecord) -> None:
        self.timer.cancel()
        status = record.status
        done = f"'{self._event.action}' is taken; the mission is {status.state}"
        reason = f": {status.reason}" if status.reason else ""
        self._report(not refusal, refusal or done + reason)

    def _give_up(self) -> None:
        self._report(
            False,
            f"'{self._event.action}' was handed to the robot, which did not answer within "
            f"{PATIENCE_S:g} s; see whether its ticks arrive",
        )

    def _report(self, is_done: bool, text: str) -> None:
        if self._first.acquire(blocking=False):
            self._on_outcome(is_done, text)
