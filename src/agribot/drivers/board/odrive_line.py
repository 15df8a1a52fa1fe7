"""Questions to an ODrive by its ASCII protocol, whose answers do not say to which they belong.

One batch of questions is under way at a time, and counts when all of it was answered. After a line
that does not fit, or none in time, the answers under way are of unknown questions: the next batch
follows a word of questions that no batch has, and that is longer than the words before that were
not answered. What answers it, one number or two, shows where the answers to the new batch begin.

Source: ODrive's documentation, "ASCII Protocol", and its firmware (communication/ascii_protocol):
`COMMAND *N` carries the exclusive or of what stands before the star. A line whose N is wrong is
left out, an answer to one that has N ends in *N, too.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Sequence
from functools import reduce
from operator import xor
from typing import NamedTuple

LONGEST_LINE = 256
VOLTAGE = "r vbus_voltage"
PATIENCE_S = 0.15  # time for the answers to a batch
DOUBLINGS = 2  # most doublings after several lost batches in a row
MOST_LOST = 40  # batches in a row
ONE, TWO = 1, 2  # numbers in an answer


class OdriveAnswers(NamedTuple):
    """The numbers that answer each question of a batch, which was asked at `asked_s`."""

    asked_s: float
    by_question: dict[str, tuple[float, ...]]


def write_line(command: str) -> str:
    """Write a command with its checksum."""
    text = f"{command} "
    return f"{text}*{compute_checksum(text)}\n"


def split_answer(line: bytes) -> tuple[str, bool] | None:
    """Split an answer into its text and whether it has a checksum; None where that is wrong."""
    text, star, checksum = line.decode("ascii", "replace").rstrip().rpartition("*")
    if not star:
        return checksum, False
    return (
        (text, True) if checksum.isdecimal() and int(checksum) == compute_checksum(text) else None
    )


def compute_checksum(text: str) -> int:
    return reduce(xor, text.encode("ascii", "replace"), 0)


class OdriveLine:
    """Asks in the control loop's thread, and takes bytes in another one.

    `bad` counts lines that did not fit, and batches without an answer.
    """

    def __init__(self, motion: str, now_s: Callable[[], float]) -> None:
        """`motion` is a question that two numbers answer."""
        self._motion, self._now_s = motion, now_s
        self._lock = threading.Lock()
        self.bad = 0
        self.open()

    def open(self) -> None:
        """Begin with a line that was just opened."""
        with self._lock:
            self._rest = b""
            self._has_checksums, self._is_sure = False, False
            self._lost, self._asked_s = 0, -math.inf
            self._questions: tuple[str, ...] = ()
            self._answers: list[tuple[float, ...]] = []
            self._word: tuple[int, ...] = ()
            self._sizes: deque[int] = deque(maxlen=len(_make_word(MOST_LOST)))

    @property
    def is_waiting(self) -> bool:
        """Whether answers to a batch are under way."""
        return bool(self._questions)

    def ask(self, questions: Sequence[str]) -> bytes:
        """Make the lines of a batch; nothing while another one may still be answered."""
        with self._lock:
            now_s = self._now_s()
            patience_s = PATIENCE_S * 2.0 ** min(max(self._lost - 2, 0), DOUBLINGS)
            if self._questions and 0.0 <= now_s - self._asked_s < patience_s:
                return b""
            if self._questions:
                self._lose_track()
            self._word = () if self._is_sure else _make_word(1 + self._lost % MOST_LOST)
            self._sizes.clear()
            self._questions, self._answers, self._asked_s = tuple(questions), [], now_s
            # Half a word before it breaks only an answer that is not needed.
            sizes = (ONE, *self._word) if self._word else ()
            asked = (*(self._motion if size == TWO else VOLTAGE for size in sizes), *questions)
        return "".join(map(write_line, asked)).encode()

    def feed(self, data: bytes) -> list[OdriveAnswers]:
        """Take bytes in; gives the batches that they complete."""
        with self._lock:
            *lines, rest = (self._rest + data).split(b"\n")
            self._rest = rest[-LONGEST_LINE:]
            return [found for line in lines if line.strip() and (found := self._take(line))]

    def _take(self, line: bytes) -> OdriveAnswers | None:
        numbers = self._read(line)
        if not self._is_sure:
            self._find_word(numbers)
            return None
        asked = self._questions[len(self._answers)] if self._questions else ""
        if not asked or len(numbers) != (TWO if asked.startswith("f ") else ONE):
            self._lose_track()
            return None
        self._answers.append(numbers)
        if len(self._answers) < len(self._questions):
            return None
        found = OdriveAnswers(self._asked_s, dict(zip(self._questions, self._answers, strict=True)))
        self._questions, self._lost = (), 0
        return found

    def _read(self, line: bytes) -> tuple[float, ...]:
        """Read the numbers of an answer; none where it is broken, or something else."""
        found = split_answer(line)
        if found is None or (self._has_checksums and not found[1]):
            return ()
        self._has_checksums = found[1]
        numbers = tuple(map(_read_number, found[0].split()))
        return numbers if all(map(math.isfinite, numbers)) else ()

    def _find_word(self, numbers: tuple[float, ...]) -> None:
        """Pass over what answers earlier questions, up to the end of the word."""
        self._sizes.append(len(numbers))
        if self._word and tuple(self._sizes)[-len(self._word) :] == self._word:
            self._is_sure = True

    def _lose_track(self) -> None:
        self.bad += 1
        self._lost += 1
        self._questions, self._word, self._is_sure = (), (), False


def _make_word(length: int) -> tuple[int, ...]:
    """Make the sizes of its answers; a batch has no single answer of two numbers."""
    return (TWO, ONE, TWO, *(ONE,) * length, TWO)


def _read_number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return math.nan
