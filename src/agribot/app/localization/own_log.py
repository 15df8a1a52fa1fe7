"""Recordings of our own: the very samples that the robot had."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from agribot.app.localization.log import LogChannel, LogEntry, LogSample, LogSensor
from agribot.core import topics
from agribot.core.messages import FloatArray, SensorBatch
from agribot.record.replay import read_ticks


class OwnLog:
    """A `run.mcap` with ticks; its IMU is in the body's axes."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        sensors: tuple[LogSensor, ...] = ("gnss", "imu", "odom", "mag")
        self.channels = tuple(
            LogChannel(sensor=sensor, source=topics.TICK.name, kind="ticks of agribot")
            for sensor in sensors
        )

    def entries(self) -> Iterator[LogEntry]:
        for record in read_ticks(self.path):
            for sensor, sample in _list_samples(record.batch):
                yield LogEntry(sensor, sample.t_s, record.batch.t_s, "", sample)

    def read_transforms(self) -> dict[str, tuple[str, FloatArray]]:
        return {}


def _list_samples(batch: SensorBatch) -> Iterator[tuple[LogSensor, LogSample]]:
    yield from (("imu", sample) for sample in batch.imu)
    yield from (("odom", sample) for sample in batch.wheels)
    yield from (("mag", sample) for sample in batch.mag)
    yield from (("base", sample) for sample in batch.base)
    yield from (("gnss", sample) for sample in batch.gnss)
    yield from (("heading", sample) for sample in batch.headings)
