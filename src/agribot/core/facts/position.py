"""Where the robot is, and what speaks against it."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import msgspec

from agribot.core.facts.base import Fact, Part, Severity, Side, Where

if TYPE_CHECKING:
    from agribot.core.facts.base import AnyFact

# Sources of the place of the start: the receiver, the mark of the field, the place where the last
# run left the robot, and the crop rows that the camera sees.
PlaceSource = Literal["gnss", "mark", "left", "rows"]
_PARTS: dict[PlaceSource, Part] = {
    "gnss": "gnss", "mark": "start", "left": "start", "rows": "camera",
}  # fmt: skip


class EstimateNotReady(Fact, frozen=True):
    """There is no estimate yet."""

    severity: ClassVar[Severity] = "note"


class NoFixesYet(Fact, frozen=True):
    """No position yet: fixes are awaited."""

    about: ClassVar[tuple[Part, ...]] = ("gnss",)
    severity: ClassVar[Severity] = "note"


class HeadingAwaited(Fact, frozen=True):
    """No heading yet: the magnetometer is awaited."""

    severity: ClassVar[Severity] = "note"


class HeadingUnknown(Fact, frozen=True):
    """No heading yet; how well the way driven shows it, where it does."""

    severity: ClassVar[Severity] = "note"
    is_compass_silent: bool
    way_m: float
    driven_m: float = 0.0
    std_rad: float | None = None

    @property
    def variant(self) -> str:
        known = "unknown" if self.std_rad is None else "known"
        return f"{known}_silent" if self.is_compass_silent else known


class FarFromMap(Fact, frozen=True):
    """The first fixes are too far from the origin of the map."""

    lat_deg: float
    lon_deg: float
    away_m: float
    origin_lat_deg: float
    origin_lon_deg: float
    limit_m: float


class StartAside(Fact, frozen=True):
    """What is known of the start contradicts itself: by `accuser` the robot is elsewhere.

    One other source alone is `against` it, which leaves open which of the two is wrong, or more.
    """

    off_m: float
    direction: str
    limit_m: float
    accuser: PlaceSource = msgspec.field(default="gnss", name="by")
    against: tuple[PlaceSource, ...] = ("mark",)

    @property
    def parts(self) -> tuple[Part, ...]:
        """The part of the odd one out, or of both."""
        sources = (self.accuser, *self.against) if len(self.against) == 1 else (self.accuser,)
        return tuple(dict.fromkeys(_PARTS[source] for source in sources))

    @property
    def variant(self) -> str:
        is_open = self.accuser == "gnss" and self.against in (("mark",), ("left",))
        return f"{self.accuser}_{self.against[0]}" if is_open else self.accuser


class StartTurned(Fact, frozen=True):
    """The robot does not face as marked at the start."""

    about: ClassVar[tuple[Part, ...]] = ("start",)
    source: str
    off_rad: float
    limit_rad: float


class CourseOff(Fact, frozen=True):
    """The sensor of the first heading disagrees with the way driven."""

    source: Literal["compass", "second antenna"]
    off_rad: float
    limit_rad: float

    @property
    def parts(self) -> tuple[Part, ...]:
        return ("compass",) if self.source == "compass" else ("gnss",)

    @property
    def variant(self) -> str:
        return "compass" if self.source == "compass" else "antenna"


class GnssSilent(Fact, frozen=True):
    """No fix comes any more."""

    about: ClassVar[tuple[Part, ...]] = ("gnss",)
    severity: ClassVar[Severity] = "warning"
    silent_s: float


class DeadReckoning(Fact, frozen=True):
    """The pose goes on without GNSS, or has done so for too long; `cause` is why."""

    cause: AnyFact
    std_m: float
    limit_m: float
    is_lost: bool

    @property
    def variant(self) -> str:
        return "lost" if self.is_lost else "known"


class CameraAndGnssDisagree(Fact, frozen=True):
    """Camera and GNSS put the robot at different places; `is_left_open`: a person decides."""

    about: ClassVar[tuple[Part, ...]] = ("camera", "gnss")
    off_m: float
    is_left_open: bool

    @property
    def kind(self) -> tuple[object, ...]:
        return (self.code,)

    @property
    def variant(self) -> str:
        return "open" if self.is_left_open else "reported"


class _OfGnss(Fact, frozen=True):
    about: ClassVar[tuple[Part, ...]] = ("gnss",)


class GnssJumped(_OfGnss, frozen=True):
    """Fixes jumped away from wheels and gyro, or the robot was carried."""

    about: ClassVar[tuple[Part, ...]] = ("gnss", "robot")
    off_m: float


class GnssJumpedFar(_OfGnss, frozen=True):
    """Fixes jumped farther than any robot is carried."""

    off_m: float


class GnssRepeats(_OfGnss, frozen=True):
    """The receiver repeats its position while the wheels turn."""

    way_m: float


class GnssCrept(_OfGnss, frozen=True):
    """Fixes crept away from their own velocity, wheels and gyro."""

    off_m: float
    over_s: float


class GnssParts(_OfGnss, frozen=True):
    """Positions and velocity of the receiver part."""

    severity: ClassVar[Severity] = "warning"
    off_m: float
    over_s: float


class FixesRejected(_OfGnss, frozen=True):
    """Fixes contradict the odometry one after the other.

    `can_be_robot`: the receiver's velocities do not show whether fixes or robot moved.
    """

    severity: ClassVar[Severity] = "warning"
    count: int
    limit: int
    can_be_robot: bool = False

    @property
    def parts(self) -> tuple[Part, ...]:
        return ("gnss", "robot") if self.can_be_robot else self.about

    @property
    def kind(self) -> tuple[object, ...]:
        return (self.code,)

    @property
    def variant(self) -> str:
        return "either" if self.can_be_robot else "receiver"


class PositionsScatter(_OfGnss, frozen=True):
    """Fixes scatter by more than they state."""

    severity: ClassVar[Severity] = "warning"
    std_m: float
    stated_m: float


class VelocityScatters(_OfGnss, frozen=True):
    """Velocities of the receiver scatter by more than they state."""

    severity: ClassVar[Severity] = "warning"
    std_mps: float
    stated_mps: float


class AntennaElsewhere(_OfGnss, frozen=True):
    """The antenna does not sit where the robot's description has it."""

    severity: ClassVar[Severity] = "warning"
    off_m: float
    sits: Where
    is_left_open: bool

    @property
    def kind(self) -> tuple[object, ...]:
        return (self.code,)

    @property
    def variant(self) -> str:
        return "open" if self.is_left_open else "reported"


class WheelsSlip(Fact, frozen=True):
    """Wheels turn and the robot hardly moves."""

    about: ClassVar[tuple[Part, ...]] = ("ground",)
    severity: ClassVar[Severity] = "warning"
    claimed_mps: float
    shown_mps: float


class RobotCarried(Fact, frozen=True):
    """The robot moved without its wheels."""

    about: ClassVar[tuple[Part, ...]] = ("robot",)
    off_m: float
    moved: Where


class HeadingJumped(Fact, frozen=True):
    """The heading was corrected by more than a turn explains; in recordings of earlier versions."""

    about: ClassVar[tuple[Part, ...]] = ("compass", "robot")
    off_rad: float


class GyroTurns(Fact, frozen=True):
    """The gyro shows a turn that compass and wheels contradict."""

    about: ClassVar[tuple[Part, ...]] = ("imu",)
    severity: ClassVar[Severity] = "warning"
    off_radps: float


class CompassTurned(Fact, frozen=True):
    """The compass shows a turn that gyro and wheels contradict."""

    about: ClassVar[tuple[Part, ...]] = ("compass",)
    severity: ClassVar[Severity] = "warning"
    off_rad: float


class WhichRow(Fact, frozen=True):
    """The crop in view fits another row better."""

    about: ClassVar[tuple[Part, ...]] = ("start",)
    rows: int
    side: Side
    certainty: float
    least: float

    @property
    def variant(self) -> str:
        return "one" if self.rows == 1 else "many"


class PlantsElsewhere(Fact, frozen=True):
    """The plants in view are those of another place of the map; None: not off that way."""

    certainty: float
    plants: int
    along_m: float | None = None
    along: Literal["ahead", "behind"] = "ahead"
    aside_m: float | None = None
    side: Side = "left"

    @property
    def variant(self) -> str:
        if self.along_m is not None and self.aside_m is not None:
            return "both"
        return "along" if self.along_m is not None else "aside"
