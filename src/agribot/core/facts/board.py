"""Motor board, contactor, battery and bumper."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import msgspec

from agribot.core.facts.base import End, Fact, Part, Severity, Side, Wheel

if TYPE_CHECKING:
    from agribot.core.facts.base import AnyFact


class BoardReports(Fact, frozen=True):
    """The motor board reports faults; in words of a recording of an earlier version."""

    said: tuple[str, ...] = ()
    of: tuple[Part, ...] = ("motors",)
    cause: AnyFact | None = None

    @property
    def parts(self) -> tuple[str, ...]:
        return self.of if self.cause is None else self.cause.parts or self.of

    @property
    def variant(self) -> str:
        return "said" if self.cause is None else "known"


class BoardHoldsStop(Fact, frozen=True):
    """The motor board holds a stop of its own; in words of a recording of an earlier version."""

    said: str = ""
    cause: AnyFact | None = None

    @property
    def parts(self) -> tuple[str, ...]:
        return ()

    @property
    def variant(self) -> str:
        return "said" if self.cause is None else "known"


BoardCause = Literal["began", "button", "bumper", "battery", "motor", "reversed"]


class BoardStopped(Fact, frozen=True):
    """Why a motor board stopped by itself; without a cause, it does not say so."""

    stop_causes: tuple[BoardCause, ...]

    @property
    def variant(self) -> str:
        return "known" if self.stop_causes else "unknown"


class _OfBoard(Fact, frozen=True):
    about: ClassVar[tuple[Part, ...]] = ("motors",)


class BoardHung(_OfBoard, frozen=True):
    """The board's program hung, and its watchdog reset it."""


class BoardUnconfigured(_OfBoard, frozen=True):
    """The board refuses its configuration."""


class WheelsReversed(Fact, frozen=True):
    """Wheels turn against their motors, as the board measures it."""

    about: ClassVar[tuple[Part, ...]] = ("wheels",)
    wheels: tuple[Wheel, ...]

    @property
    def variant(self) -> str:
        return {1: "one", 4: "all"}.get(len(self.wheels), "many")


class AxisError(_OfBoard, frozen=True):
    """An axis of a speed controller has an error; `is_expired`: it heard no command in time."""

    device: str
    axis: str
    error: int
    is_expired: bool

    @property
    def variant(self) -> str:
        return "expired" if self.is_expired else "plain"


class AxisStands(_OfBoard, frozen=True):
    """An axis of a speed controller does not drive its wheels."""

    device: str
    axis: str
    why: Literal["error", "idle", "state"]
    state: int

    @property
    def variant(self) -> str:
        return self.why


class ControllerFault(_OfBoard, frozen=True):
    """A speed controller reports a fault, by the name that its maker gives it."""

    controller: str
    fault: str


class ButtonPressed(Fact, frozen=True):
    """The red button is pressed."""

    about: ClassVar[tuple[Part, ...]] = ("button",)


_INPUTS: dict[str, Part] = {
    "red button": "button", "bumper": "bumper", "battery": "battery", "motors": "motors",
}  # fmt: skip


class _OfInput(Fact, frozen=True):
    """About a safety input of the board that it names."""

    input: str

    @property
    def parts(self) -> tuple[str, ...]:
        return ("inputs", _INPUTS[self.input]) if self.input in _INPUTS else ("inputs",)


class InputNotHeardYet(_OfInput, frozen=True):
    """A safety input that must be there has not been reported."""


class InputSilent(_OfInput, frozen=True):
    """A safety input that must be there is reported no more."""

    silent_s: float
    limit_s: float


class ContactorSilent(Fact, frozen=True):
    """The contactor is not heard."""

    about: ClassVar[tuple[Part, ...]] = ("contactor",)
    silent_s: float
    limit_s: float


class ContactorInTrouble(Fact, frozen=True):
    """The contactor cannot obey its command; in words of a recording of an earlier version."""

    about: ClassVar[tuple[Part, ...]] = ("contactor",)
    said: str = ""
    cause: AnyFact | None = None

    @property
    def variant(self) -> str:
        return "said" if self.cause is None else "known"


class RelayLost(Fact, frozen=True):
    """The line to the relay of a contactor is lost."""

    about: ClassVar[tuple[Part, ...]] = ("contactor",)
    line: str


class RelayStuck(Fact, frozen=True):
    """The line to the relay of a contactor takes nothing."""

    about: ClassVar[tuple[Part, ...]] = ("contactor",)
    line: str
    silent_s: float


class ContactorStaysClosed(Fact, frozen=True):
    """The contactor was commanded to open and did not; `is_reported`: it says so itself."""

    about: ClassVar[tuple[Part, ...]] = ("contactor",)
    is_reported: bool = msgspec.field(name="is_told")

    @property
    def variant(self) -> str:
        return "reported" if self.is_reported else "seen"


class ContactorStaysOpen(Fact, frozen=True):
    """The contactor was commanded to close and did not."""

    about: ClassVar[tuple[Part, ...]] = ("contactor",)


class ContactorWelded(Fact, frozen=True):
    """One of two contactors stayed closed."""

    about: ClassVar[tuple[Part, ...]] = ("contactor",)


class NoContactor(Fact, frozen=True):
    """The robot has none."""

    severity: ClassVar[Severity] = "note"


class MotorsUnpowered(Fact, frozen=True):
    """The motors have no power yet."""

    severity: ClassVar[Severity] = "note"


class WheelsTurnUnpowered(Fact, frozen=True):
    """Wheels turn though the motors have no power."""

    about: ClassVar[tuple[Part, ...]] = ("motors", "wheels")
    speed_radps: float


class _OfBattery(Fact, frozen=True):
    """A fault by the battery's charge where that is known, else by its voltage."""

    about: ClassVar[tuple[Part, ...]] = ("battery",)
    left_percent: float | None = None
    limit_percent: float | None = None
    left_v: float | None = None
    limit_v: float | None = None

    @property
    def variant(self) -> str:
        return "voltage" if self.left_percent is None else "charge"

    @property
    def kind(self) -> tuple[object, ...]:
        return self.code, self.variant


class BatteryLow(_OfBattery, frozen=True):
    """Enough is left to go home."""

    severity: ClassVar[Severity] = "warning"


class BatteryEmpty(_OfBattery, frozen=True):
    """Too little is left to drive."""


class Touched(Fact, frozen=True):
    """The bumper touches something, here on the robot."""

    about: ClassVar[tuple[Part, ...]] = ("bumper",)
    end: End
    ahead_m: float
    aside_m: float
    side: Side


class StillTouches(Fact, frozen=True):
    """The bumper still touches something."""

    about: ClassVar[tuple[Part, ...]] = ("bumper",)
    ends: tuple[End, ...]


class OnlyAway(Fact, frozen=True):
    """A hand may only drive straight away from what the bumper touches."""

    about: ClassVar[tuple[Part, ...]] = ("bumper",)
    ends: tuple[End, ...]


class _OfObstacle(Fact, frozen=True):
    """A person or a thing, and the way until the robot would touch it."""

    way_m: float


class ObstacleInWay(_OfObstacle, frozen=True):
    """Something is in the way; the robot waits until it is free."""

    severity: ClassVar[Severity] = "warning"


class ObstacleNearWay(_OfObstacle, frozen=True):
    """Something is near the way, or in it farther on; the robot drives slowly."""

    severity: ClassVar[Severity] = "note"


class ObstacleStays(Fact, frozen=True):
    """Something stays in the way; a person has to look."""

    waited_s: float
    cause: AnyFact
