"""A robot's program that stands still for a while, as one does that is stopped or starved.

The world goes on: sensors measure, and the motor board hears no command.
"""

from __future__ import annotations

from collections.abc import Sequence

from agribot.core.messages import Inbox, RobotCommand, SensorBatch
from agribot.core.messages.sensors import join_batches
from agribot.core.platform import Platform
from agribot.sim.faults.schedule import ROUNDING_S, Fault


class StalledProgram:
    """The fault `program.stalled` between a platform and the stack."""

    def __init__(self, platform: Platform, faults: Sequence[Fault]) -> None:
        self._platform = platform
        self._due = sorted(
            (fault for fault in faults if fault.name == "program.stalled"),
            key=lambda fault: fault.begin_s,
        )

    @property
    def inbox(self) -> Inbox:
        return self._platform.inbox

    def read(self) -> SensorBatch:
        """Return the next batch, or that of the first tick after a standstill, with all before."""
        batches = [self._platform.read()]
        while self._due and self._due[0].begin_s <= batches[-1].t_s + ROUNDING_S:
            end_s = self._due[0].begin_s + self._due.pop(0).number
            while batches[-1].t_s < end_s - ROUNDING_S:
                batches.append(self._platform.read())
        return batches[0] if len(batches) == 1 else join_batches(batches)

    def write(self, command: RobotCommand) -> None:
        self._platform.write(command)

    def close(self) -> None:
        self._platform.close()
