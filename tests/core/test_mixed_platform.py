"""A robot of parts from different places ends safely, whatever one of them does."""

from __future__ import annotations

import pytest

from agribot.core.messages import Inbox, RobotCommand, SensorBatch
from agribot.core.platform import MixedPlatform, Sensor


class Part:
    """A sensor that notes when it is closed, and fails then on request."""

    def __init__(self, sensor: Sensor, closed: list[str], failure: str = "") -> None:
        self.sensor, self.name = sensor, "somewhere"
        self._closed, self._failure = closed, failure

    def take(self, t_s: float) -> tuple[()]:
        return ()

    def close(self) -> None:
        self._closed.append(self.sensor)
        if self._failure:
            raise OSError(self._failure)


class ActingPart(Part):
    def write(self, command: RobotCommand) -> None: ...


class Wheels:
    def __init__(self, closed: list[str]) -> None:
        self.inbox, self._closed = Inbox(), closed

    def read(self) -> SensorBatch:
        return SensorBatch(t_s=0.0)

    def write(self, command: RobotCommand) -> None: ...

    def close(self) -> None:
        self._closed.append("wheels")


def test_power_and_wheels_are_stopped_before_any_sensor_is_waited_for() -> None:
    closed: list[str] = []
    parts = [Part("gnss", closed), Part("imu", closed), ActingPart("contactor", closed)]
    MixedPlatform(Wheels(closed), parts).close()
    assert closed[:2] == ["contactor", "wheels"]
    assert sorted(closed) == ["contactor", "gnss", "imu", "wheels"]


@pytest.mark.parametrize("sensor", ["gnss", "contactor"])
def test_a_part_that_fails_at_the_end_leaves_no_other_one_open(sensor: Sensor) -> None:
    closed: list[str] = []
    parts = [ActingPart(sensor, closed, "it broke"), Part("imu", closed)]
    with pytest.raises(OSError, match="it broke"):
        MixedPlatform(Wheels(closed), parts).close()
    assert sorted(closed) == sorted([sensor, "imu", "wheels"])
