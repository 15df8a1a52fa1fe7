"""Everything AGRIBOT raises on purpose, as one tree.

AgribotError
├── ConfigError         a setting is unknown, out of range or contradicts another
├── DescriptionError    a robot or world file cannot be understood
├── MissionError        a field, plan or waypoint list cannot be driven
├── PerceptionError     model weights are missing or do not fit the camera
├── RecordingError      a run cannot be written or read back
├── BridgeError         another program cannot be reached, or sends unreadable data
└── PlatformError       the robot or the simulator stopped answering
    └── EndOfRecording  a replay has no more batches: the normal end, not a fault

A message says what happened, the value, the limit and what to do about it. A MissionError carries a
fact, whose text is made where it is shown.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from os import PathLike

    from agribot.core.facts import AnyFact


class AgribotError(Exception):
    """Base of all errors that a user can act on; the command line prints it without a traceback."""


class ConfigError(AgribotError):
    pass


class DescriptionError(AgribotError):
    pass


class MissionError(AgribotError):
    """Why there is no such field, plan or way; its text is that of the fact."""

    def __init__(self, fact: AnyFact) -> None:
        super().__init__(fact)
        self.fact = fact

    def __str__(self) -> str:
        from agribot.core.fact_text import render

        return render(self.fact)


class PerceptionError(AgribotError):
    pass


class RecordingError(AgribotError):
    pass


class BridgeError(AgribotError):
    pass


class PlatformError(AgribotError):
    pass


class EndOfRecording(PlatformError):
    pass


def describe_range(least: float, most: float = math.inf, unit: str = "") -> str:
    """State that a value is out of its range, and what to give: the end of a message."""
    low, high = format_number(least), format_number(most)
    wanted = f"at least {low}" if most == math.inf else f"{low} to {high}"
    return f"out of range; give {wanted} {unit}".rstrip()


def format_number(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.12g}"


# Advice about a file or folder that the system refuses.
CHECK_PATH, OTHER_OUT = "check the path", "choose another --out folder"
CHECK_DISK = "check that the folder is writable and the disk has room"
MAKE_ROOM = "make room and run the same command again"


class explain_os_error:
    """Raise what the system refuses as one error: the fact, why, and what to do."""

    def __init__(self, fact: str, advice: str, kind: type[AgribotError] = RecordingError) -> None:
        self._fact, self._advice, self._kind = fact, advice, kind

    def __enter__(self) -> None: ...

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        if isinstance(error, OSError):
            why = error.strerror or error
            raise self._kind(f"{self._fact}: {why}; {self._advice}") from error


def explain_unreadable(path: PathLike[str], error: OSError) -> str:
    """State that a file cannot be read, and why."""
    return f"cannot read {path}: {error.strerror or error}; {CHECK_PATH}"


def add_advice(fact: str, advice: str) -> str:
    """Add what to do to a fact that does not say it yet."""
    return fact if has_advice(fact) else f"{fact}; {advice}"


def has_advice(fact: str) -> bool:
    """Whether an error of another says what to do."""
    return ";" in fact
