"""A log of a robot as sensor samples, whatever file they come from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, NamedTuple, Protocol

import msgspec

from agribot.core.messages import (
    BaseFix,
    FloatArray,
    GnssFix,
    GnssHeading,
    ImuSample,
    MagSample,
    WheelSample,
)

LogSensor = Literal["gnss", "imu", "odom", "mag", "base", "heading"]
# Those that have a channel of their own; a base and the heading of two antennas come with GNSS.
LOG_SENSORS: tuple[LogSensor, ...] = ("gnss", "imu", "odom", "mag")
WITH_GNSS: tuple[LogSensor, ...] = ("base", "heading")


class TwistSample(msgspec.Struct, frozen=True, kw_only=True):
    """Speed of a base that reports its motion instead of its wheels."""

    t_s: float
    v_mps: float
    yaw_rate_radps: float


LogSample = GnssFix | GnssHeading | BaseFix | ImuSample | MagSample | WheelSample | TwistSample


class LogEntry(NamedTuple):
    """A sample with its stamp, when it was logged, and the frame that it speaks of.

    Both times are seconds of the log, usually since 1970; `t_s` of the sample is not set. Without a
    sample, as of a receiver without a fix, the entry still counts as a message.
    """

    sensor: LogSensor
    stamp_s: float
    logged_s: float
    frame: str
    sample: LogSample | None


class LogChannel(msgspec.Struct, frozen=True, kw_only=True):
    """Source of a sensor: a topic or a file; `others` are those that could have been."""

    sensor: LogSensor
    source: str
    kind: str
    others: tuple[str, ...] = ()
    count: int = 0  # number of messages, where the file says it


class RobotLog(Protocol):
    """One or more files of a drive. `notes` are complete after a whole pass of `entries`."""

    @property
    def channels(self) -> tuple[LogChannel, ...]:
        """The source of each of its sensors."""
        ...

    @property
    def notes(self) -> list[str]:
        """Faults of the files, in words."""
        ...

    def entries(self) -> Iterator[LogEntry]:
        """Iterate over all samples in the order in which they were logged."""
        ...

    def read_transforms(self) -> dict[str, tuple[str, FloatArray]]:
        """Read the fixed frames: child -> parent and `parent_from_child` (4, 4)."""
        ...
