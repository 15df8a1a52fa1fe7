"""`autonomous-drive`: distance and heading error in, twists out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from agribot.autonomy.control.go_to_goal import GoToGoal
from agribot.core import topics
from agribot.core.messages import STOP
from agribot.core.topics import Topic
from agribot.ros.messages import rosmsg
from agribot.ros.nodes.stage import EndlessStage, OutgoingMessage


class AutonomousDrive(EndlessStage):
    """Publishes a twist ten times a second, zero whenever it has no reason to drive."""

    inputs = (topics.DISTANCE, topics.ANGLE)
    outputs = (topics.CMD_VEL,)

    def __init__(self, go: GoToGoal) -> None:
        self._go = go

    @property
    def reason(self) -> str:  # type: ignore[override]
        return self._go.reason

    def receive(self, topic: Topic, message: Any, t_s: float) -> Sequence[OutgoingMessage]:
        if topic is topics.DISTANCE:
            self._go.update_distance(t_s, message.data)
        elif topic is topics.ANGLE:
            self._go.update_error(t_s, math.radians(message.data))
        return ()

    def tick(self, t_s: float) -> Sequence[OutgoingMessage]:
        return (OutgoingMessage(topics.CMD_VEL, rosmsg.make_drive_twist(self._go.command(t_s))),)

    def finish(self) -> Sequence[OutgoingMessage]:
        return (OutgoingMessage(topics.CMD_VEL, rosmsg.make_drive_twist(STOP)),)
