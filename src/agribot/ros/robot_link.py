"""What a running robot makes of requests: what its mission answers, and where it stands."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable

import msgspec

from agribot.core.fact_text import render
from agribot.core.facts import AnyFact
from agribot.core.messages import AnyRequest, Inbox, TickRecord, Who

PATIENCE_S = 4.0
_MOST_OPEN = 100  # requests without an answer; the oldest is forgotten

# Gets why it is refused, or None, and the record of the tick; called in the robot's thread.
OnAnswer = Callable[[AnyFact | None, TickRecord], None]
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
                on_answer(answer.fact, record)

    def post(self, request: AnyRequest, who: Who, on_answer: OnAnswer) -> None:
        """Post a request; `on_answer` is called once, when the mission took or refused it."""
        with self._lock:
            key = f"peer-{next(self._numbers)}"
            while len(self._open) >= _MOST_OPEN:
                self._open.pop(next(iter(self._open)))
            self._open[key] = on_answer
        self._inbox.post(msgspec.structs.replace(request, id=key), who)

    def ask(self, request: AnyRequest, who: Who, on_outcome: OnOutcome) -> None:
        """Post a request; call `on_outcome` once, at the latest when patience ends."""
        asked = _Asked(request.word, on_outcome)
        self.post(request, who, asked.settle)
        asked.timer.start()


class _Asked:
    """Whatever comes first counts: the mission's answer, or the end of patience."""

    def __init__(self, word: str, on_outcome: OnOutcome) -> None:
        self._word, self._on_outcome = word, on_outcome
        self._first = threading.Semaphore()
        self.timer = threading.Timer(PATIENCE_S, self._give_up)
        self.timer.daemon = True

    def settle(self, refusal: AnyFact | None, record: TickRecord) -> None:
        self.timer.cancel()
        status = record.status
        done = f"'{self._word}' is taken; the mission is {status.state}"
        reason = f": {status.reason}" if status.reason else ""
        self._report(refusal is None, render(refusal) or done + reason)

    def _give_up(self) -> None:
        self._report(
            False,
            f"'{self._word}' was handed to the robot, which did not answer within "
            f"{PATIENCE_S:g} s; see whether its ticks arrive",
        )

    def _report(self, is_done: bool, text: str) -> None:
        if self._first.acquire(blocking=False):
            self._on_outcome(is_done, text)
