"""The small interface to a robot: a simulator, real hardware or a recording."""

from __future__ import annotations

from typing import Protocol

from agribot.messages import RobotCommand, SensorBatch


class Platform(Protocol):
    """Nothing above this interface knows whether the robot is real."""

    def read(self) -> SensorBatch:
        """Wait for the next tick and return what arrived since the last one.

        Raises: PlatformError: the robot does not answer any more.
        """
        ...

    def write(self, command: RobotCommand) -> None:
        """Send a command; it holds until the next one, or until the platform's own timeout."""
        ...

    def close(self) -> None:
        """Stop the wheels and the implement, and release everything. Safe to call twice."""
        ...
