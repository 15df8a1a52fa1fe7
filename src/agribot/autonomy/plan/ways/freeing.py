"""How a stuck robot gets free: it backs out along its track and tries the place once more.

Only the ground behind it is known to carry it: it has just come from there.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import msgspec
import numpy as np

from agribot.autonomy.plan.ways.curves import Segment, sample
from agribot.core.arithmetic import clamp
from agribot.core.errors import MissionError
from agribot.core.facts import JustSetOff
from agribot.core.geo import wrap_rad
from agribot.core.messages import Estimate, Path
from agribot.core.pose import Pose2


class Try(NamedTuple):
    """A try: the distance to back out for it, and the offset to the left of the path after it."""

    back_m: float
    left_m: float


# Attempts to get free, each with its run-up and offset aside. Where a run-up was not enough, other
# parts of the wheels meet the clods. None goes farther aside than a robot may be that knows where
# it is: crop stands beside its wheels.
TRIES = (Try(0.3, 0.0), Try(0.5, 0.06), Try(0.5, -0.06), Try(0.8, 0.06), Try(0.8, -0.06))
LEAST_BACK_M = 0.1  # shortest run-up
SAME_PLACE_M = 1.5  # distance within which tries are at the same place
STEP_M, TRAIL_M = 0.05, 1.2
MOST_GAP_M = 0.5  # largest gap; a robot farther away went on elsewhere: on an errand, or carried
# A robot that was shaken, or turned on the spot, did not come on a tighter bend.
MAX_CURVATURE_RADPM = 1.0


class Trail:
    """The last metre that the robot came, as poses in the map."""

    def __init__(self) -> None:
        self._poses: deque[Pose2] = deque(maxlen=math.ceil(TRAIL_M / STEP_M))

    def add(self, here: Pose2) -> None:
        """Add where the robot is; what lies ahead of it, wheels have only claimed."""
        poses = self._poses
        while poses and here.locate(*poses[-1].xy_m)[0] > 0.0:
            poses.pop()
        gap_m = math.dist(here.xy_m, poses[-1].xy_m) if poses else math.inf
        if gap_m > MOST_GAP_M:
            poses.clear()
        if gap_m >= STEP_M:
            poses.append(here)

    @property
    def length_m(self) -> float:
        return math.dist(self._poses[0].xy_m, self._poses[-1].xy_m) if self._poses else 0.0

    def plan_back(self, here: Pose2, back_m: float) -> Path:
        """Plan the way back on the bend on which it came; it ends where the trail begins.

        Raises: MissionError: the robot has not come far enough.
        """
        then = next(
            (pose for pose in reversed(self._poses) if math.dist(here.xy_m, pose.xy_m) >= back_m),
            self._poses[0] if self._poses else here,
        )
        came_m = min(math.dist(here.xy_m, then.xy_m), back_m)
        if came_m < LEAST_BACK_M:
            raise MissionError(JustSetOff())
        bend_radpm = wrap_rad(here.yaw_rad - then.yaw_rad) / came_m
        bend_radpm = clamp(bend_radpm, -MAX_CURVATURE_RADPM, MAX_CURVATURE_RADPM)
        course = Pose2(here.x_m, here.y_m, here.yaw_rad + math.pi)
        way = sample(course, [Segment(came_m, -bend_radpm)])
        yaw_rad = np.array([wrap_rad(yaw - math.pi) for yaw in way.yaw_map_rad.tolist()])
        return msgspec.structs.replace(way, yaw_map_rad=yaw_rad)


class Freeing:
    """Counts the tries at a place. Call `follow` in every tick of a drive forwards."""

    def __init__(self) -> None:
        self.trail = Trail()
        self._tries = 0
        self._place: tuple[float, float] | None = None  # place of the first try of those that count

    def restart(self) -> None:
        """Forget the tries: a person has looked, or the robot has left the place."""
        self._tries, self._place = 0, None

    def follow(self, estimate: Estimate) -> None:
        here = Pose2(estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
        self.trail.add(here)
        if self._place is not None and math.dist(here.xy_m, self._place) > SAME_PLACE_M:
            self.restart()

    def may_try(self, most_tries: int) -> bool:
        """Whether the robot may back out where it is, and try again."""
        return self.has_tries(most_tries) and self.trail.length_m >= LEAST_BACK_M

    def has_tries(self, most_tries: int) -> bool:
        return self._tries < most_tries

    def begin(self, estimate: Estimate) -> float:
        """Count a try; return how far to back out for it."""
        if self._place is None:
            self._place = (estimate.x_map_m, estimate.y_map_m)
        self._tries += 1
        return self._try.back_m

    @property
    def left_m(self) -> float:
        """Offset to the left of the path here; 0 where nothing has held the robot."""
        return self._try.left_m if self._tries else 0.0

    @property
    def _try(self) -> Try:
        return TRIES[min(self._tries, len(TRIES)) - 1]
