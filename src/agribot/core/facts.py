"""Facts: what is found at run time, as small typed values, from where it is found to the edge.

A fault, a doubt, a contradiction, a hazard, a stop's cause and a state's reason are each one
`Fact`: a frozen struct of a closed, tagged union (`AnyFact`). It says

- its `code`, which is its class's name in snake case and never changes its meaning,
- its `parts`: those of the robot that are at fault, more than one where it leaves open which,
  those of the facts inside it included; a part that it is only compared with is not among them,
- its `severity`, and
- numbers in fields that name their units.

`None` stands for "nothing found". Nothing inside the program compares, masks or parses text: two
facts are the same while their `kind` is, which leaves out the numbers, and what a fact is about is
asked by `parts`, its class or its code. `fact_text.render` alone makes text, from one table for
each language (`facts.en.toml`, `facts.de.toml`): at the edge, for the page, logs, reports, ROS and
the text fields of messages. A new fact is a class here and a section in each table; a test compares
codes and placeholders.

`Said` holds words from outside (a person, a device, an error of a planner): nothing looks into it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Union

import msgspec

Part = Literal["gnss", "compass", "imu", "wheels", "motors", "ground", "camera", "network",
               "bumper", "button", "contactor", "battery", "clock", "link", "disk", "start",
               "robot", "crop", "inputs", "program", "lidar"]  # fmt: skip
# note: nothing is wrong; warning: the robot goes on; fault: it must not, or not by itself.
Severity = Literal["note", "warning", "fault"]
Wheel = Literal["right_wheel_R", "left_wheel_R", "right_wheel_F", "left_wheel_F"]
Side = Literal["left", "right"]
Where = Literal["left", "right", "ahead", "behind"]
End = Literal["front", "behind"]  # ends of the robot
Unspoken = Literal["wheels", "imu", "gnss", "compass", "lidar"]  # a sensor that may fall silent
Motion = Literal["stand", "backwards", "fast", "slow"]  # motions of wheels, against their command
Check = Literal["board", "imu", "imu_cable", "cable", "gnss", "compass", "wheels", "lidar"]

# A sensor, a board, the program or the encoder of one wheel may be silent for moments.
ComingAndGoing = Literal["gnss", "compass", "imu", "wheels", "camera", "board", "contactor",
                         "program", "right_wheel_R", "left_wheel_R", "right_wheel_F",
                         "left_wheel_F"]  # fmt: skip

_CAPITAL = re.compile(r"(?<!^)(?=[A-Z])")


def _make_code(name: str) -> str:
    return _CAPITAL.sub("_", name).lower()


class Fact(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="code", tag=_make_code):
    """A finding; see the module."""

    about: ClassVar[tuple[Part, ...]] = ()
    severity: ClassVar[Severity] = "fault"

    @property
    def code(self) -> str:
        """Its stable name."""
        return str(self.__struct_config__.tag)

    @property
    def values(self) -> tuple[tuple[str, Any], ...]:
        """Its fields by name."""
        return tuple((name, getattr(self, name)) for name in self.__struct_fields__)

    @property
    def inner(self) -> tuple[Fact, ...]:
        """The facts that it holds."""
        return tuple(value for _, value in self.values if isinstance(value, Fact))

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts at fault, those of the facts inside it included."""
        found = dict.fromkeys(self.about)
        for fact in self.inner:
            found.update(dict.fromkeys(fact.parts))
        return tuple(found)

    @property
    def kind(self) -> tuple[object, ...]:
        """The part that stays the same while only numbers change."""
        values = (value.kind if isinstance(value, Fact) else value for _, value in self.values)
        return (self.code, *(value for value in values if not _is_number(value)))

    @property
    def numbers(self) -> dict[str, float]:
        """Its finite numbers by name, and those of the facts inside it under names of their own."""
        found: dict[str, float] = {}
        for fact in self.inner:
            found.update(fact.numbers)
        own = {name: value for name, value in self.values if _is_number(value)}
        found.update({name: float(value) for name, value in own.items() if math.isfinite(value)})
        return found

    @property
    def variant(self) -> str:
        """Name of the text that fits; empty where there is one."""
        return ""

    @property
    def causes(self) -> tuple[str, ...]:
        """The codes of the facts inside it, the nearest first."""
        return tuple(code for fact in self.inner for code in (fact.code, *fact.causes))

    def holds(self, other: Fact) -> bool:
        """Whether it is the same but for numbers as another, or a fact inside it is."""
        return self.kind == other.kind or any(fact.holds(other) for fact in self.inner)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def find_kind(fact: Fact | None) -> tuple[object, ...]:
    """Return what stays the same of a fact while its numbers change; empty without a fact."""
    return () if fact is None else fact.kind


# --- words from outside ---


class Said(Fact, frozen=True):
    """Words of a person, a device or an error; `by` is who said it, where that matters."""

    text: str
    by: str = ""


# --- sensors that say nothing, too late, or no numbers ---


_UNSPOKEN: dict[str, Part] = {
    "wheels": "wheels", "imu": "imu", "gnss": "gnss", "compass": "compass", "lidar": "lidar",
}  # fmt: skip


class _OfSensor(Fact, frozen=True):
    """About one sensor that it names."""

    sensor: Unspoken

    @property
    def parts(self) -> tuple[Part, ...]:
        return (_UNSPOKEN[self.sensor],)


class SensorSilent(_OfSensor, frozen=True):
    """A sensor was heard and is no more; `check` is where to look."""

    silent_s: float
    limit_s: float
    check: Check


class NoDataYet(_OfSensor, frozen=True):
    """A sensor has sent nothing that the estimate could use."""

    severity: ClassVar[Severity] = "note"
    check: Check


class NotHeardYet(_OfSensor, frozen=True):
    """A sensor has not reported since the start."""

    severity: ClassVar[Severity] = "note"

    @property
    def variant(self) -> str:
        return "many" if self.sensor == "wheels" else "one"


class SensorNotFinite(_OfSensor, frozen=True):
    """A sensor sends NaN or infinity."""

    @property
    def variant(self) -> str:
        return "many" if self.sensor == "wheels" else "one"


class ImuSpoilt(Fact, frozen=True):
    """A number of the IMU is beyond the range of any such sensor."""

    about: ClassVar[tuple[Part, ...]] = ("imu",)
    severity: ClassVar[Severity] = "warning"
    value: float


class ImuLineSpoilt(Fact, frozen=True):
    """Several numbers of the IMU were beyond its range within seconds."""

    about: ClassVar[tuple[Part, ...]] = ("imu",)
    count: int
    within_s: float
    limit_s: float


class ImuLate(Fact, frozen=True):
    """Samples of the IMU come late."""

    about: ClassVar[tuple[Part, ...]] = ("imu",)
    severity: ClassVar[Severity] = "warning"
    late_s: float


class ImuFrozen(Fact, frozen=True):
    """The IMU repeats itself while the wheels turn."""

    about: ClassVar[tuple[Part, ...]] = ("imu",)
    same_s: float


class Tilted(Fact, frozen=True):
    """The robot is tilted too far."""

    about: ClassVar[tuple[Part, ...]] = ("robot",)
    tilt_rad: float
    limit_rad: float


class TiltUnknown(Fact, frozen=True):
    """The IMU measures no acceleration, so that no tilt is watched."""

    about: ClassVar[tuple[Part, ...]] = ("imu", "robot")
    severity: ClassVar[Severity] = "warning"


# --- devices and their lines ---


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


# --- the clock ---


class _OfClock(Fact, frozen=True):
    about: ClassVar[tuple[Part, ...]] = ("clock",)


class PoseClockWentBack(_OfClock, frozen=True):
    """The clock went back by more than the pose can follow."""

    back_s: float


class ClockUnreadable(_OfClock, frozen=True):
    """The clock reads no finite time."""

    t_s: float


class ClockWentBack(_OfClock, frozen=True):
    """The clock went back."""

    back_s: float


class ClockJumped(_OfClock, frozen=True):
    """The clock jumped, or the program stood still."""

    about: ClassVar[tuple[Part, ...]] = ("clock", "program")
    off_s: float
    limit_s: float


class ClockStands(_OfClock, frozen=True):
    """The clock stands still."""

    t_s: float


class ClockLeapt(_OfClock, frozen=True):
    """The clock jumped between two readings of wheels that turned evenly."""

    severity: ClassVar[Severity] = "warning"
    off_s: float


# --- how the robot and its program are, as a page shows it ---


class ProgramEnded(Fact, frozen=True):
    """The robot's program is gone."""

    about: ClassVar[tuple[Part, ...]] = ("program",)


class ProgramSilent(Fact, frozen=True):
    """The robot's program has sent no tick for a while."""

    about: ClassVar[tuple[Part, ...]] = ("program",)
    silent_s: float


class _OfHealth(Fact, frozen=True):
    severity: ClassVar[Severity] = "note"


class NoTickYet(_OfHealth, frozen=True):
    """The robot's program has sent no tick yet."""


class TicksArrive(_OfHealth, frozen=True):
    """The robot's program runs."""


class PositionKnown(_OfHealth, frozen=True):
    """How well the position is known."""

    std_m: float
    is_poor: bool

    @property
    def variant(self) -> str:
        return "poor" if self.is_poor else "good"


class PositionUnknown(_OfHealth, frozen=True):
    """There is no position, and perhaps why."""

    cause: AnyFact | None = None

    @property
    def variant(self) -> str:
        return "plain" if self.cause is None else "why"


class BatteryHolds(_OfHealth, frozen=True):
    """Voltage and charge of the battery."""

    voltage_v: float
    charge_percent: float | None
    is_low: bool

    @property
    def variant(self) -> str:
        if self.charge_percent is None:
            return "volts"
        return "low" if self.is_low else "charge"


class RateLow(Fact, frozen=True):
    """Something comes less often than it should."""

    severity: ClassVar[Severity] = "warning"
    measured_hz: float
    expected_hz: float


class DiskFree(_OfHealth, frozen=True):
    """Room on the disk."""

    about: ClassVar[tuple[Part, ...]] = ("disk",)
    free_gb: float
    is_low: bool

    @property
    def variant(self) -> str:
        return "low" if self.is_low else "enough"


class PagesConnected(_OfHealth, frozen=True):
    """Pages, the states that were too old for them, and the clients that were turned away."""

    pages: int
    states_left_out: int
    refused: int


# --- where the robot is ---


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
    """The robot does not stand at the marked start."""

    about: ClassVar[tuple[Part, ...]] = ("start",)
    off_m: float
    direction: str
    limit_m: float


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
    """Fixes contradict the odometry one after the other."""

    severity: ClassVar[Severity] = "warning"
    count: int
    limit: int


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
    """The heading was corrected by more than a turn explains."""

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


# --- the camera ---


class _OfCamera(Fact, frozen=True):
    about: ClassVar[tuple[Part, ...]] = ("camera",)
    severity: ClassVar[Severity] = "warning"


class NoPicture(_OfCamera, frozen=True):
    """No picture was seen for some time."""

    silent_s: float


class PicturesComeLate(_OfCamera, frozen=True):
    """Pictures come late to the estimate."""

    late_s: float


class PictureFrozen(_OfCamera, frozen=True):
    """The picture has not changed while the robot moved."""

    way_m: float


class PictureReversed(_OfCamera, frozen=True):
    """The picture moves against the way of the robot."""


class PictureMirrored(_OfCamera, frozen=True):
    """The picture turns against the turns of the robot."""


class PictureUnfit(_OfCamera, frozen=True):
    """Pictures show nothing to go by; `why` is what the perception says of them."""

    why: str

    @property
    def kind(self) -> tuple[object, ...]:
        return (self.code,)


class CropUnknown(_OfCamera, frozen=True):
    """The network sees no crop where the rows are."""

    share_ratio: float
    way_m: float
    row: int


class RowLineMoved(_OfCamera, frozen=True):
    """The row line moved without the robot."""

    severity: ClassVar[Severity] = "fault"
    off_m: float


class RowLinesScatter(_OfCamera, frozen=True):
    """Row lines scatter aside by more than they state."""

    std_m: float
    stated_m: float


class RowHeadingsScatter(_OfCamera, frozen=True):
    """The directions of row lines scatter by more than they state."""

    std_rad: float
    stated_rad: float


class CameraSilent(_OfCamera, frozen=True):
    """The camera sends no picture."""

    silent_s: float
    limit_s: float


class CameraLate(_OfCamera, frozen=True):
    """The camera's pictures are old when they come."""

    late_s: float
    limit_s: float


class NetworkSilent(_OfCamera, frozen=True):
    """The network says nothing of the pictures."""

    about: ClassVar[tuple[Part, ...]] = ("network", "camera")
    silent_s: float
    limit_s: float


# --- wheels, motors, ground ---


class MotorsReportFault(Fact, frozen=True):
    """The board flags motors."""

    about: ClassVar[tuple[Part, ...]] = ("motors",)
    wheels: tuple[str, ...]

    @property
    def variant(self) -> str:
        return "one" if len(self.wheels) == 1 else "many"


class MotorDead(Fact, frozen=True):
    """A motor gives no torque while the others work."""

    about: ClassVar[tuple[Part, ...]] = ("motors",)
    wheel: Wheel


class WheelsWrong(Fact, frozen=True):
    """Wheels do not follow their command."""

    about: ClassVar[tuple[Part, ...]] = ("wheels",)
    wheels: tuple[Wheel, ...]
    motion: Motion
    speed_radps: float
    wanted_radps: float

    @property
    def variant(self) -> str:
        return f"{self.motion}_{ {1: 'one', 4: 'all'}.get(len(self.wheels), 'many') }"


class WheelsSwapped(Fact, frozen=True):
    """The robot turns opposite to its command."""

    about: ClassVar[tuple[Part, ...]] = ("motors", "wheels")


class Runaway(Fact, frozen=True):
    """Wheels turn that are to stand, and what to do about it."""

    about: ClassVar[tuple[Part, ...]] = ("motors",)
    cause: AnyFact
    is_cut: bool
    is_contactor_stuck: bool

    @property
    def variant(self) -> str:
        return "stuck" if self.is_contactor_stuck else "cut" if self.is_cut else "driven"


class TurnsDisagree(Fact, frozen=True):
    """Gyro and wheels contradict each other."""

    about: ClassVar[tuple[Part, ...]] = ("imu", "wheels")
    gyro_radps: float
    wheels_radps: float


class HeldInTurn(Fact, frozen=True):
    """The robot does not turn with its wheels."""

    about: ClassVar[tuple[Part, ...]] = ("ground",)
    gyro_radps: float
    wheels_radps: float


class Stuck(Fact, frozen=True):
    """The robot stays behind its wheels."""

    about: ClassVar[tuple[Part, ...]] = ("ground",)
    way_m: float
    lasted_s: float
    moved_m: float


# --- motor board, contactor, battery, bumper ---


class BoardReports(Fact, frozen=True):
    """The motor board reports faults; in words of a recording of an earlier version."""

    said: tuple[str, ...] = ()
    of: tuple[Part, ...] = ("motors",)
    cause: AnyFact | None = None

    @property
    def parts(self) -> tuple[Part, ...]:
        return self.of if self.cause is None else self.cause.parts or self.of

    @property
    def variant(self) -> str:
        return "said" if self.cause is None else "known"


class BoardHoldsStop(Fact, frozen=True):
    """The motor board holds a stop of its own; in words of a recording of an earlier version."""

    said: str = ""
    cause: AnyFact | None = None

    @property
    def parts(self) -> tuple[Part, ...]:
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
    def parts(self) -> tuple[Part, ...]:
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
    """The contactor was commanded to open and did not; `is_told`: it reports so itself."""

    about: ClassVar[tuple[Part, ...]] = ("contactor",)
    is_told: bool

    @property
    def variant(self) -> str:
        return "reported" if self.is_told else "seen"


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


# --- the gate ---


class CommandNotFinite(Fact, frozen=True):
    """A drive command is no number."""

    v_mps: float
    yaw_rate_radps: float


class ImplementNotFinite(Fact, frozen=True):
    """A command to the implement is no number."""

    setpoints: str


class NoPosition(Fact, frozen=True):
    """There is no position to drive by."""

    cause: AnyFact


class PositionNotFinite(Fact, frozen=True):
    """The position is no number."""


class PositionOld(Fact, frozen=True):
    """The position is of another time."""

    old_s: float
    limit_s: float


class PositionUnsure(Fact, frozen=True):
    """The position is too uncertain."""

    std_m: float
    limit_m: float


class HeadingUnsure(Fact, frozen=True):
    """The heading is too uncertain."""

    std_rad: float
    limit_rad: float


class LeavesBox(Fact, frozen=True):
    """The robot is about to leave the box around its path, or has left it."""

    x_map_m: float
    y_map_m: float
    is_inside: bool

    @property
    def variant(self) -> str:
        return "inside" if self.is_inside else "outside"


class BeyondField(Fact, frozen=True):
    """The robot is beyond the edge of the field."""

    x_map_m: float
    y_map_m: float


class LeavesField(Fact, frozen=True):
    """The robot is about to leave the field; `is_by_hand`: a person takes it there."""

    x_map_m: float
    y_map_m: float
    is_by_hand: bool

    @property
    def variant(self) -> str:
        return "hand" if self.is_by_hand else "plan"


class NearEdgeAndDoubted(Fact, frozen=True):
    """Too near to the edge for sensors that contradict each other."""

    x_map_m: float
    y_map_m: float
    aside_m: float


class NearEdgeAndUnsure(Fact, frozen=True):
    """Too near to the edge for a position of this sigma."""

    x_map_m: float
    y_map_m: float
    std_m: float


class _AtKeepOut(Fact, frozen=True):
    """Place where an area to keep out of is touched, and that of the robot."""

    area_x_map_m: float
    area_y_map_m: float
    x_map_m: float
    y_map_m: float


class EntersKeepOut(_AtKeepOut, frozen=True):
    """The robot is about to enter an area to keep out of."""


class InKeepOut(_AtKeepOut, frozen=True):
    """The robot is in an area to keep out of."""


class MissionIdle(Fact, frozen=True):
    """No mission drives the robot."""

    severity: ClassVar[Severity] = "note"
    state: str
    cause: AnyFact | None = None

    @property
    def variant(self) -> str:
        return "plain" if self.cause is None else "why"


class ToolEarly(Fact, frozen=True):
    """The tool works before the robot drives."""


class ToolAtRest(Fact, frozen=True):
    """The tool must not work: the robot stands, or no mission drives it."""

    severity: ClassVar[Severity] = "note"


class ToolBackwards(Fact, frozen=True):
    """The tool does not work backwards."""

    severity: ClassVar[Severity] = "note"


class SpeedLimited(Fact, frozen=True):
    """A command was too fast."""

    severity: ClassVar[Severity] = "note"
    speed_mps: float
    limit_mps: float


class YawRateLimited(Fact, frozen=True):
    """A command turned too fast."""

    severity: ClassVar[Severity] = "note"
    yaw_rate_radps: float
    limit_radps: float


class StoppedBy(Fact, frozen=True):
    """Somebody pressed STOP."""

    by: str


class StoppedAgainBy(Fact, frozen=True):
    """Somebody pressed STOP, and often."""

    by: str
    times: int


class Disarmed(Fact, frozen=True):
    """A machine begins stopped."""


class NotCleared(Fact, frozen=True):
    """A stop of an earlier run, not cleared since a date and time."""

    cause: AnyFact
    since: str


class StopToClear(Fact, frozen=True):
    """The robot stands until the stop is cleared."""

    cause: AnyFact


class StopCleared(Fact, frozen=True):
    """A person cleared the stop; `then` is why the robot still stands."""

    severity: ClassVar[Severity] = "note"
    by: str
    then: AnyFact | None = None

    @property
    def variant(self) -> str:
        return ("known" if self.by else "unknown") if self.then is None else "then"


class DrivenByHand(Fact, frozen=True):
    """Somebody drives."""

    severity: ClassVar[Severity] = "note"
    by: str


class MissionSetsOff(Fact, frozen=True):
    """All that is checked before the start is good."""

    severity: ClassVar[Severity] = "note"


class MissionGoesOn(Fact, frozen=True):
    """The mission drives again."""

    severity: ClassVar[Severity] = "note"


class Over(Fact, frozen=True):
    """What held the robot is over."""

    severity: ClassVar[Severity] = "note"
    cause: AnyFact | None = None


# --- the mission ---


class _MissionNote(Fact, frozen=True):
    severity: ClassVar[Severity] = "note"


class FirstEstimateAwaited(_MissionNote, frozen=True):
    """The mission waits for the first estimate."""


class PositionAwaited(_MissionNote, frozen=True):
    """The mission waits for a position."""

    cause: AnyFact


class Settling(_MissionNote, frozen=True):
    """The mission waits for the estimate to settle."""


class PlanningWay(_MissionNote, frozen=True):
    """The way is being planned."""


class StartUnsure(Fact, frozen=True):
    """Neither the pose nor a camera knows the rows."""

    std_m: float
    limit_m: float


class OffPath(Fact, frozen=True):
    """The robot has left its path."""

    off_m: float
    limit_m: float
    x_map_m: float
    y_map_m: float


class RowLost(Fact, frozen=True):
    """The robot does not know well enough where its row is."""

    std_m: float
    limit_m: float


class MayBeOffRow(Fact, frozen=True):
    """The protection level is more than from wheels to crop."""

    level_m: float
    limit_m: float


class NoHeadway(Fact, frozen=True):
    """The robot does not get on."""

    limit_s: float
    s_m: float
    length_m: float
    cause: AnyFact | None = None

    @property
    def variant(self) -> str:
        return "plain" if self.cause is None else "why"


class NoPositionFor(Fact, frozen=True):
    """The mission has waited too long for its position."""

    limit_s: float
    cause: AnyFact


class PositionLost(Fact, frozen=True):
    """The position was lost on the way."""

    cause: AnyFact | None = None

    @property
    def variant(self) -> str:
        return "plain" if self.cause is None else "why"


class PausedBy(_MissionNote, frozen=True):
    """Somebody paused the mission."""

    by: str


class PausedByHand(_MissionNote, frozen=True):
    """Somebody took the robot by hand."""

    by: str


class PausedByLoss(_MissionNote, frozen=True):
    """The operator is not heard any more."""

    of: str


class CancelledBy(_MissionNote, frozen=True):
    """Somebody ended the mission."""

    by: str


class StopToResume(Fact, frozen=True):
    """The mission stands for a stop."""

    cause: AnyFact


class ResumeAwaited(_MissionNote, frozen=True):
    """The stop was cleared, and the mission was not resumed."""


class GoalAwaited(_MissionNote, frozen=True):
    """The mission waits for a goal."""


class AtGoal(_MissionNote, frozen=True):
    """The robot is at the goal of somebody."""

    by: str


class StopsToReturn(_MissionNote, frozen=True):
    """The robot stops to return home."""

    by: str


class StopsForGoal(_MissionNote, frozen=True):
    """The robot stops for a goal."""

    by: str


class StopsToBackOut(Fact, frozen=True):
    """The robot backs out, for a cause."""

    cause: AnyFact
    leg: Literal["back", "out", "free"]


class FoundRowAside(_MissionNote, frozen=True):
    """The robot found its row aside."""


class ReturnedHome(_MissionNote, frozen=True):
    """The robot is at home, called by somebody."""

    by: str


class CameToBeCharged(_MissionNote, frozen=True):
    """The robot is at home to be charged."""


class NewTask(_MissionNote, frozen=True):
    """Somebody sent a new task."""

    action: str
    by: str


class CutOff(_MissionNote, frozen=True):
    """The mission was cut off; what held it, or what it was doing."""

    cause: AnyFact


class AwayFromWork(_MissionNote, frozen=True):
    """The robot was away from its work."""


class OnVisit(_MissionNote, frozen=True):
    """The robot was on a visit."""

    name: str


class OnErrandOf(_MissionNote, frozen=True):
    """The robot was on an errand that somebody asked for."""

    leg: str
    by: str


class NotResumed(_MissionNote, frozen=True):
    """The mission was not resumed."""

    cause: AnyFact


class ErrandRefused(_MissionNote, frozen=True):
    """There is no way for an errand."""

    errand: Literal["home", "charge", "goal", "work", "back", "out", "free"]
    cause: AnyFact


# --- what a request is refused for ---


class NotStarted(_MissionNote, frozen=True):
    """The mission was not started."""

    cause: AnyFact


class RowNotSkipped(_MissionNote, frozen=True):
    """The row was not left out."""

    cause: AnyFact


class RowNotMoved(_MissionNote, frozen=True):
    """The line of the row was not moved."""

    cause: AnyFact


class TaskRefused(_MissionNote, frozen=True):
    """Another task was not taken."""

    task: Literal["plan", "visit"]
    cause: AnyFact


class SpeedRefused(_MissionNote, frozen=True):
    """A speed is more than the robot may drive."""

    speed_mps: float
    limit_mps: float


class MissionEnded(_MissionNote, frozen=True):
    """The mission has ended; `can_start`: a start begins it once more."""

    can_start: bool = False

    @property
    def variant(self) -> str:
        return "open" if self.can_start else "closed"


class StopHolds(_MissionNote, frozen=True):
    """The stop must be cleared first."""


class NothingPlanned(_MissionNote, frozen=True):
    """There is no route yet."""


class AwayFromRows(_MissionNote, frozen=True):
    """The robot is on an errand."""


class InNoRow(_MissionNote, frozen=True):
    """The robot is in no row."""


class RowMovedFar(_MissionNote, frozen=True):
    """The line of a row is as far aside as it may be."""

    row: int
    limit_m: float


class NoOtherTask(_MissionNote, frozen=True):
    """The mission takes no other task."""


class RobotDrives(_MissionNote, frozen=True):
    """The robot must stand for it."""


class AskedElse(_MissionNote, frozen=True):
    """Another request took its place."""


class OwnPathOnly(_MissionNote, frozen=True):
    """The task knows no ways beside its own path."""


class GoalNotFinite(_MissionNote, frozen=True):
    """A goal is no number."""


class NoPlaces(_MissionNote, frozen=True):
    """A visit names no places."""


class ThereAlready(_MissionNote, frozen=True):
    """The robot is at its goal."""


class JustSetOff(_MissionNote, frozen=True):
    """The robot has not come far enough to back out on its track."""


class AllRowsWorked(_MissionNote, frozen=True):
    """No row is left to resume."""


class TooFarAway(_MissionNote, frozen=True):
    """The nearest place to drive to is too far from the robot."""

    away_m: float
    limit_m: float


class BeyondFence(_MissionNote, frozen=True):
    """A place lies beyond the fence around the task."""

    x_map_m: float
    y_map_m: float
    beyond_m: float


class OnCropThere(_MissionNote, frozen=True):
    """The robot would stand on crop at a place."""

    x_map_m: float
    y_map_m: float


class NoWayOffCrop(_MissionNote, frozen=True):
    """No way to a place keeps off the crop, for a reason of the planner."""

    x_map_m: float
    y_map_m: float
    cause: AnyFact


class CarriedAway(_MissionNote, frozen=True):
    """The robot is not where its work stopped."""

    about: ClassVar[tuple[Part, ...]] = ("robot",)
    away_m: float
    x_map_m: float
    y_map_m: float
    limit_m: float


class Both(Fact, frozen=True):
    """One fact and then another."""

    first: AnyFact
    second: AnyFact


def join_facts(facts: Sequence[AnyFact]) -> AnyFact | None:
    """Make one fact of several, in their order; None of none."""
    joined: AnyFact | None = None
    for fact in reversed(facts):
        joined = fact if joined is None else Both(fact, joined)
    return joined


class RowsSkipped(_MissionNote, frozen=True):
    """Rows were skipped, as asked."""

    rows: tuple[int, ...]


class RowsUndriven(Fact, frozen=True):
    """The path ended with rows that were not driven."""

    rows: tuple[int, ...]


class RowsUnproven(Fact, frozen=True):
    """Rows were driven without evidence: what each lacks, and how many more there are."""

    said: tuple[str, ...]
    more: int

    @property
    def variant(self) -> str:
        return "more" if self.more else "all"


class WaypointsMissed(Fact, frozen=True):
    """Waypoints were passed at too great a distance."""

    waypoints: tuple[int, ...]
    limit_m: float


if TYPE_CHECKING:
    AnyFact = Fact
else:

    def _list_kinds(base: type[Fact]) -> list[type[Fact]]:
        found = []
        for kind in base.__subclasses__():
            found += _list_kinds(kind) or [kind]
        return found

    AnyFact = Union[tuple(_list_kinds(Fact))]  # noqa: UP007 (a type made at run time)

KINDS: tuple[type[Fact], ...] = tuple(AnyFact.__args__) if not TYPE_CHECKING else ()
