"""Sensors that are silent, late, or send no numbers."""

from __future__ import annotations

from typing import ClassVar

from agribot.core.facts.base import Check, Fact, Part, Severity, Unspoken

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
    """A number of the IMU is beyond the range of any such sensor: its own, or its line's."""

    about: ClassVar[tuple[Part, ...]] = ("imu", "link")
    severity: ClassVar[Severity] = "warning"
    value: float


class ImuLineSpoilt(Fact, frozen=True):
    """Several numbers of the IMU were beyond its range within seconds."""

    about: ClassVar[tuple[Part, ...]] = ("imu", "link")
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
