"""Devices and their lines."""

from __future__ import annotations

from typing import ClassVar, Literal

from agribot.core.facts.base import ComingAndGoing, Fact, Part, Severity

_SOURCES: dict[str, Part] = {
    "gnss": "gnss", "imu": "imu", "mag": "compass", "wheels": "wheels", "frames": "camera",
    "contactor": "contactor", "scans": "lidar",
}  # fmt: skip


class _OfSource(Fact, frozen=True):
    """About what a field of the batch comes from."""

    field: str
    source: str

    @property
    def parts(self) -> tuple[Part, ...]:
        return (_SOURCES[self.field],) if self.field in _SOURCES else ()


class SourceSilent(_OfSource, frozen=True):
    """A source has sent nothing for some time."""

    silent_s: float
    limit_s: float


class SourceHeard(_OfSource, frozen=True):
    """A source that was silent sends again."""

    severity: ClassVar[Severity] = "note"


_COME_AND_GO: dict[str, Part] = {
    "gnss": "gnss", "compass": "compass", "imu": "imu", "wheels": "wheels", "camera": "camera",
    "board": "link", "contactor": "contactor", "program": "program", "right_wheel_R": "wheels",
    "left_wheel_R": "wheels", "right_wheel_F": "wheels", "left_wheel_F": "wheels",
}  # fmt: skip


class ComesAndGoes(Fact, frozen=True):
    """A sensor, a board, one encoder or the program itself fell silent several times, briefly."""

    severity: ClassVar[Severity] = "warning"
    silent_part: ComingAndGoing
    count: int
    within_min: float
    longest_s: float

    @property
    def parts(self) -> tuple[Part, ...]:
        return (_COME_AND_GO[self.silent_part],)

    @property
    def variant(self) -> str:
        return "program" if self.silent_part == "program" else "part"


class _OfLine(Fact, frozen=True):
    """About the line to a device, which has a name besides."""

    about: ClassVar[tuple[Part, ...]] = ("link",)
    device: Literal["receiver", "board"]
    name: str


class LineNoisy(_OfLine, frozen=True):
    """A line breaks messages."""

    severity: ClassVar[Severity] = "warning"
    count: int
    within_s: float


class LineClean(_OfLine, frozen=True):
    """A line that broke messages does not any more."""

    severity: ClassVar[Severity] = "note"
    clean_s: float


class TimesUnsure(Fact, frozen=True):
    """The times of a device are known too badly."""

    severity: ClassVar[Severity] = "warning"
    device: str
    off_s: float
    limit_s: float


class TimesKnown(Fact, frozen=True):
    """The times of a device are known well enough."""

    severity: ClassVar[Severity] = "note"
    device: str
    off_s: float


class CorrectionsMissing(Fact, frozen=True):
    """No corrections come from a caster, in the words of what asks for them."""

    severity: ClassVar[Severity] = "warning"
    caster: str
    why: str
    is_lost: bool  # they have come before

    @property
    def variant(self) -> str:
        return "lost" if self.is_lost else "none"


class CorrectionsCome(Fact, frozen=True):
    """Corrections come from a caster."""

    severity: ClassVar[Severity] = "note"
    caster: str
    is_again: bool

    @property
    def variant(self) -> str:
        return "again" if self.is_again else "first"


class DeviceSaid(Fact, frozen=True):
    """Something is wrong with a device, in words of its driver."""

    severity: ClassVar[Severity] = "warning"
    said: str
    of: tuple[Part, ...] = ()

    @property
    def parts(self) -> tuple[Part, ...]:
        return self.of


class DeviceWell(Fact, frozen=True):
    """A device is well again, in words of its driver."""

    severity: ClassVar[Severity] = "note"
    said: str
