"""CSV files of a drive: one row a reading, columns by name and unit."""

from __future__ import annotations

import csv
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TextIO

from agribot.app.localization import table_columns
from agribot.app.localization.log import LogChannel, LogEntry, LogSample, LogSensor, TwistSample
from agribot.app.localization.places import check_place
from agribot.app.localization.table_columns import Column, Columns, TimeColumn
from agribot.app.localization.wheel_ticks import SpeedWheels, TickWheels
from agribot.core.errors import (
    CHECK_PATH,
    BridgeError,
    RecordingError,
    add_advice,
    explain_os_error,
)
from agribot.core.messages import FloatArray, GnssFix, GnssQuality, ImuSample, MagSample

EMPTY = ("", "nan", "null", "none")
DELIMITERS = (",", ";", "\t")
AXES = ("x", "y", "z")
# 1 sigma of a fix without a stated one: a receiver without corrections, m.
USUAL_STD_M = 2.5
_STATUS_QUALITY = {0: GnssQuality.SINGLE, 1: GnssQuality.DGNSS, 2: GnssQuality.RTK_FLOAT}

ReadRow = Callable[[float, Sequence[str]], LogSample | None]
# Makes a reader for the columns of a file, new for each pass; None where they are not there.
MakeReader = Callable[[Columns], ReadRow | None]


class TableLog:
    """A CSV file; `sensors` are those wanted of it; empty means all."""

    def __init__(
        self, path: Path, ticks_per_turn: float | None, sensors: Sequence[LogSensor] = ()
    ) -> None:
        """Find the columns.

        Raises: RecordingError: no such file, no time, or nothing that a sensor measures.
        """
        self.path = path
        self.notes: list[str] = []
        self._makers = make_readers(ticks_per_turn)
        columns = Columns(self._read_names())
        TimeColumn(columns, str(path))
        self._found = tuple(
            sensor
            for sensor, make in self._makers.items()
            if (not sensors or sensor in sensors) and make(columns) is not None
        )
        if not self._found:
            wanted = " or ".join(sensors) or "sensor"
            raise RecordingError(
                f"{path} has no columns of a {wanted}, only {', '.join(self._read_names()[:12])}; "
                "docs/localize.md lists their names"
            )
        self.channels = tuple(
            LogChannel(sensor=sensor, source=path.name, kind="CSV") for sensor in self._found
        )

    def entries(self) -> Iterator[LogEntry]:
        with self._open() as file:
            rows = csv.reader(file, delimiter=self._delimiter)
            columns = Columns(next(rows, []))
            time = TimeColumn(columns, str(self.path))
            readers = [
                (sensor, read)
                for sensor in self._found
                if (read := self._makers[sensor](columns)) is not None
            ]
            for number, cells in enumerate(rows, 2):
                yield from self._read_row(number, cells, time, readers)

    def _read_row(
        self, number: int, cells: Sequence[str], time: TimeColumn,
        readers: Sequence[tuple[LogSensor, ReadRow]],
    ) -> Iterator[LogEntry]:  # fmt: skip
        if not any(cell.strip() for cell in cells):
            return
        try:
            t_s = time.read(cells)
            found = [(sensor, read(t_s, cells)) for sensor, read in readers]
        except (ValueError, IndexError) as error:
            raise RecordingError(
                f"{self.path}:{number}: {error}; write numbers in all columns that are not empty"
            ) from error
        except BridgeError as error:
            fact = f"{self.path}:{number}: {error}"
            raise RecordingError(add_advice(fact, "correct the line, or leave it out")) from error
        for sensor, sample in found:
            if sample is not None:
                yield LogEntry(sensor, t_s, t_s, "", sample)

    def read_transforms(self) -> dict[str, tuple[str, FloatArray]]:
        return {}

    def _open(self) -> TextIO:
        with explain_os_error(f"cannot read {self.path}", CHECK_PATH):
            return self.path.open(newline="", encoding="utf-8-sig")

    def _read_names(self) -> list[str]:
        with self._open() as file:
            line = file.readline()
        self._delimiter = find_delimiter(line)
        return split_names(line)


def make_readers(ticks_per_turn: float | None) -> dict[LogSensor, MakeReader]:
    """Make the makers of row readers by sensor."""
    return {
        "gnss": read_fixes,
        "imu": read_imu,
        "odom": lambda columns: read_wheels(columns, ticks_per_turn),
        "mag": read_mag,
    }


def read_fixes(columns: Columns) -> ReadRow | None:
    lat, lon = columns.find(table_columns.LATITUDE), columns.find(table_columns.LONGITUDE)
    if lat is None or lon is None:
        return None
    alt, std, variance = (
        columns.find(names)
        for names in (table_columns.ALTITUDE, table_columns.STD, table_columns.VARIANCE)
    )
    quality, status = columns.find(table_columns.QUALITY), columns.find(table_columns.STATUS)

    def read(_: float, cells: Sequence[str]) -> GnssFix | None:
        known = _read_quality(cells, quality, status)
        if _is_empty(cells, (lat, lon)) or known is GnssQuality.NONE:
            return None
        lat_deg, lon_deg = lat.read(cells), lon.read(cells)
        check_place(lat_deg, lon_deg)
        std_m = USUAL_STD_M
        if std is not None and cells[std.at].strip():
            std_m = std.read(cells)
        elif variance is not None and variance.read(cells) > 0.0:
            std_m = math.sqrt(variance.read(cells))
        return GnssFix(
            t_s=0.0, lat_deg=lat_deg, lon_deg=lon_deg,
            alt_m=alt.read(cells) if alt is not None and cells[alt.at].strip() else 0.0,
            pos_std_m=std_m, quality=known,
        )  # fmt: skip

    return read


def _read_quality(
    cells: Sequence[str], quality: Column | None, status: Column | None
) -> GnssQuality:
    if quality is not None and cells[quality.at].strip():
        number = int(quality.read(cells))
        return GnssQuality(number) if number in set(GnssQuality) else GnssQuality.SINGLE
    if status is not None:
        return _STATUS_QUALITY.get(int(status.read(cells)), GnssQuality.NONE)
    return GnssQuality.SINGLE


def read_imu(columns: Columns) -> ReadRow | None:
    gyro, accel = (
        columns.find_parts(table_columns.GYRO, AXES),
        columns.find_parts(table_columns.ACCEL, AXES),
    )
    if not gyro or not accel:
        return None

    def read(_: float, cells: Sequence[str]) -> ImuSample | None:
        if _is_empty(cells, (*gyro, *accel)):
            return None
        wx, wy, wz = (column.read(cells) for column in gyro)
        ax, ay, az = (column.read(cells) for column in accel)
        return ImuSample(t_s=0.0, gyro_radps=(wx, wy, wz), accel_mps2=(ax, ay, az))

    return read


def read_mag(columns: Columns) -> ReadRow | None:
    mag = columns.find_parts(table_columns.MAG, AXES)
    if not mag:
        return None

    def read(_: float, cells: Sequence[str]) -> MagSample | None:
        if _is_empty(cells, mag):
            return None
        x, y, z = (column.read(cells) for column in mag)
        return MagSample(t_s=0.0, field_t=(x, y, z))

    return read


def read_wheels(columns: Columns, ticks_per_turn: float | None) -> ReadRow | None:
    speed, yaw_rate = columns.find(table_columns.SPEED), columns.find(table_columns.YAW_RATE)
    if speed is not None and yaw_rate is not None:
        return lambda _, cells: (
            None
            if _is_empty(cells, (speed, yaw_rate))
            else TwistSample(t_s=0.0, v_mps=speed.read(cells), yaw_rate_radps=yaw_rate.read(cells))
        )
    pairs: list[tuple[table_columns.Names, Callable[[float, float, float], LogSample]]] = [
        (table_columns.RADPS, SpeedWheels().turn),
        (table_columns.RAD, TickWheels(math.tau).turn_angles),
        (table_columns.TICKS, _count_ticks(ticks_per_turn)),
    ]
    for names, turn in pairs:
        sides = columns.find_parts(names, table_columns.SIDES)
        if sides:
            return _read_pair(sides, turn)
    return None


def _read_pair(
    sides: Sequence[Column], turn: Callable[[float, float, float], LogSample]
) -> ReadRow:
    left, right = sides
    return lambda t_s, cells: (
        None if _is_empty(cells, sides) else turn(t_s, left.read(cells), right.read(cells))
    )


def _count_ticks(ticks_per_turn: float | None) -> Callable[[float, float, float], LogSample]:
    if ticks_per_turn is not None:
        return TickWheels(ticks_per_turn).turn

    def refuse(t_s: float, left: float, right: float) -> LogSample:
        raise BridgeError("encoder counts need to know the wheel; give --ticks-per-turn")

    return refuse


def _is_empty(cells: Sequence[str], columns: Sequence[Column]) -> bool:
    return any(
        len(cells) <= column.at or cells[column.at].strip().lower() in EMPTY for column in columns
    )


def find_delimiter(line: str) -> str:
    """Find what stands between the names of the columns."""
    return max(DELIMITERS, key=line.count)


def split_names(line: str) -> list[str]:
    return next(csv.reader([line], delimiter=find_delimiter(line)), [])


def has_header(first_line: str) -> bool:
    """Return whether a line of text may be the names of a CSV file's columns."""
    words = list(itertools.takewhile(lambda name: name.strip(), split_names(first_line)))
    return len(words) > 2 and not any(word.strip().lstrip("-+")[:1].isdigit() for word in words)
