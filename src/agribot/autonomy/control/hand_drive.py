"""Driving by hand: who may move the robot now, the mission or a person.

The order is stop > hand > mission. A hand that moves the robot pauses the mission, which goes on
only when somebody resumes it: a robot never sets off by itself because a thumb slipped.
"""

from __future__ import annotations

from agribot.core.config import SafetyConfig
from agribot.core.facts import PausedByHand
from agribot.core.messages import (
    DriveCommand,
    HandDrive,
    MissionStatus,
    PauseFor,
    RequestEvent,
    SensorBatch,
)


class HandControl:
    """Keeps the newest request of a hand for as long as it may count (`safety.hand_timeout_s`)."""

    def __init__(self, config: SafetyConfig) -> None:
        self._timeout_s = config.hand_timeout_s
        self._newest: HandDrive | None = None

    def update(self, batch: SensorBatch) -> tuple[RequestEvent, ...]:
        """Take in the requests of this tick.

        Returns the pause that a hand imposes on the mission in the moment it moves the robot.
        """
        if batch.hand:
            self._newest = batch.hand[-1]
        newest = self._newest
        # A clock that runs backwards ends the request as well as one that is old.
        if newest is not None and not 0.0 <= batch.t_s - newest.t_s < self._timeout_s:
            self._newest = newest = None
        if newest is None or not batch.hand or not _moves(newest):
            return ()
        pause = PauseFor(cause=PausedByHand(newest.who.name))
        return (RequestEvent(t_s=batch.t_s, who=newest.who, request=pause),)

    def arbitrate(self, drive: DriveCommand, status: MissionStatus) -> tuple[DriveCommand, bool]:
        """Choose the command; the flag is True where it is the hand's.

        A stick held at rest leaves a running mission alone.
        """
        newest = self._newest
        if newest is None or status.state == "running":
            return drive, False
        return DriveCommand(v_mps=newest.v_mps, yaw_rate_radps=newest.yaw_rate_radps), True


def _moves(hand: HandDrive) -> bool:
    return not (hand.v_mps == 0.0 and hand.yaw_rate_radps == 0.0)
