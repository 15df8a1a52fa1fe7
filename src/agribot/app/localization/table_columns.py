"""Which columns of a CSV file hold what, in which unit: by their names."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import NamedTuple

from agribot.core.errors import RecordingError

DEG = math.pi / 180.0
G_MPS2 = 9.80665

# Name -> factor to the unit of the product.
Names = Mapping[str, float]


class Column(NamedTuple):
    """Index of a value's column, and its factor to SI."""

    at: int
    factor: float

    def read(self, cells: Sequence[str]) -> float:
        value = float(cells[self.at]) * self.factor
        if not math.isfinite(value):
            raise ValueError(f"{cells[self.at]} is not finite")
        return value


TIMES: Names = {
    "stamp_s": 1.0, "t_s": 1.0, "time_s": 1.0, "timestamp_s": 1.0, "unix_s": 1.0, "stamp": 1.0,
    "time": 1.0, "timestamp": 1.0, "t": 1.0, "t_ms": 1e-3, "time_ms": 1e-3, "timestamp_ms": 1e-3,
    "t_us": 1e-6, "time_us": 1e-6, "timestamp_us": 1e-6, "t_ns": 1e-9, "stamp_ns": 1e-9,
    "time_ns": 1e-9, "timestamp_ns": 1e-9, "header.stamp": 1e-9, "%time": 1e-9,
    "header.stamp.sec": 1.0, "log_time_s": 1.0,
}  # fmt: skip
UTC_TIMES = ("time_utc", "utc", "datetime")
NANOSECONDS: Names = {"header.stamp.nanosec": 1e-9}
GYRO: Names = {
    "gyro_{}_radps": 1.0, "angular_velocity.{}": 1.0, "gyro_{}": 1.0, "gyro_{}_dps": DEG,
    "gyro_{}_degps": DEG, "w{}_radps": 1.0, "w{}_dps": DEG,
}  # fmt: skip
ACCEL: Names = {
    "accel_{}_mps2": 1.0, "linear_acceleration.{}": 1.0, "accel_{}": 1.0, "acc_{}": 1.0,
    "accel_{}_g": G_MPS2, "a{}_mps2": 1.0, "a{}_g": G_MPS2,
}  # fmt: skip
MAG: Names = {"mag_{}_t": 1.0, "magnetic_field.{}": 1.0, "mag_{}_ut": 1e-6, "mag_{}": 1.0}
SPEED: Names = {
    "v_mps": 1.0, "speed_mps": 1.0, "twist.twist.linear.x": 1.0, "twist.linear.x": 1.0,
    "linear.x": 1.0, "v_kmph": 1.0 / 3.6,
}  # fmt: skip
YAW_RATE: Names = {
    "yaw_rate_radps": 1.0, "w_radps": 1.0, "twist.twist.angular.z": 1.0, "twist.angular.z": 1.0,
    "angular.z": 1.0, "yaw_rate_dps": DEG,
}  # fmt: skip
LATITUDE: Names = {"lat_deg": 1.0, "latitude": 1.0, "lat": 1.0, "latitude_deg": 1.0}
LONGITUDE: Names = {"lon_deg": 1.0, "longitude": 1.0, "lon": 1.0, "longitude_deg": 1.0}
ALTITUDE: Names = {"alt_m": 1.0, "altitude": 1.0, "alt": 1.0, "height_m": 1.0}
STD: Names = {"pos_std_m": 1.0, "std_m": 1.0, "h_acc_m": math.sqrt(0.5)}
VARIANCE: Names = {"position_covariance[0]": 1.0}
QUALITY: Names = {"quality": 1.0, "fix_quality": 1.0}
STATUS: Names = {"status.status": 1.0}
SIDES = ("left", "right")
RADPS: Names = {"{}_radps": 1.0, "{}_wheel_radps": 1.0, "{}_rpm": math.tau / 60.0}
MPS: Names = {"{}_mps": 1.0, "{}_wheel_mps": 1.0}
RAD: Names = {"{}_rad": 1.0, "{}_wheel_rad": 1.0}
TICKS: Names = {"{}_ticks": 1.0, "{}_encoder": 1.0, "ticks_{}": 1.0, "encoder_{}": 1.0}


class Columns:
    """The columns of a file by their names."""

    def __init__(self, names: Sequence[str]) -> None:
        cleaned = [name.strip().lower().removeprefix("field.") for name in names]
        self._at = {name: index for index, name in reversed(list(enumerate(cleaned)))}

    def find(self, names: Names) -> Column | None:
        """Find the first of the names that is there."""
        found = ((self._at[name], factor) for name, factor in names.items() if name in self._at)
        return next((Column(*each) for each in found), None)

    def find_parts(self, names: Names, parts: Sequence[str]) -> tuple[Column, ...]:
        """Find a column for each part (`x`, `left`) of the first pattern that has all; or none."""
        for pattern, factor in names.items():
            wanted = [pattern.format(part) for part in parts]
            if all(name in self._at for name in wanted):
                return tuple(Column(self._at[name], factor) for name in wanted)
        return ()

    def find_text(self, names: Sequence[str]) -> int | None:
        return next((self._at[name] for name in names if name in self._at), None)


class TimeColumn:
    """The time of a row, seconds."""

    def __init__(self, columns: Columns, source: str) -> None:
        """Find it. Raises: RecordingError: no column is a time."""
        self._seconds, self._rest = columns.find(TIMES), columns.find(NANOSECONDS)
        self._text = columns.find_text(UTC_TIMES)
        if self._seconds is None and self._text is None:
            raise RecordingError(
                f"{source} has no column of times; call one stamp_s (seconds since 1970), t_ns or "
                "time_utc"
            )

    def read(self, cells: Sequence[str]) -> float:
        if self._seconds is None:
            assert self._text is not None
            moment = datetime.fromisoformat(cells[self._text].strip().replace("Z", "+00:00"))
            return moment.timestamp()
        seconds = self._seconds.read(cells)
        return seconds + (self._rest.read(cells) if self._rest is not None else 0.0)
