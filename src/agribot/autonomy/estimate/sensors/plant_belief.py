"""Where the robot may stand by the plants that it has passed: places and their probabilities.

The way is cut into pieces. What was seen on each piece weighs every place by Bayes' rule, and each
place moves with the odometry from piece to piece and is put right by the plants there, so that
wheels that slip do not add up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from agribot.autonomy.estimate.filter.history import Motion
from agribot.autonomy.estimate.filter.stem_map import StemMap
from agribot.autonomy.estimate.sensors.plant_match import (
    MatchedPlace,
    Prior,
    SeenPlants,
    find_places,
)
from agribot.autonomy.estimate.sensors.plant_window import PlantWindow
from agribot.core.geo import wrap_rad
from agribot.core.messages import FloatArray, Scene
from agribot.core.pose import Pose2

# Length of a piece of way, and motion between two looks at all of it.
PIECE_M, LOOK_M = 2.0, 0.25
# Fewest plants that are judged.
FEWEST = 4
# Errors of the way and the heading by wheels and gyro over a piece, 1 sigma; half a step of the
# headings that are tried is part of the second.
PIECE_STD_M, PIECE_STD_RAD = 0.06, math.radians(1.5)
# Probability that the robot is at none of the places that were likely before, against the
# likeliest.
LOST_RATIO = 1e-5


class PlantBelief:
    """Call `add` with every picture; `places` are as of the last look, the likeliest first."""

    def __init__(self, plants: StemMap) -> None:
        self._plants, self._window = plants, PlantWindow()
        self.restart()

    def restart(self) -> None:
        """Forget all: the robot may stand anywhere."""
        self._window = PlantWindow()
        self.places: list[MatchedPlace] = []
        self._before: list[MatchedPlace] = []
        self._began: tuple[Motion, float] | None = None  # this piece of way, and its heading
        self._looked: Motion | None = None
        self.seen = 0  # plants on this piece of way

    def add(
        self,
        scene: Scene,
        then: Motion,
        yaw_rad: float,
        around: tuple[float, float, float] | None,
        turns_rad: Sequence[float],
        start: Prior | None,
    ) -> bool:
        """Take in a picture; whether `places` are new, of where the robot was at the picture.

        `around` and `turns_rad` as in `find_places`; `start` is what was known of the place before
        any plant was seen.
        """
        self._began = self._began or (then, yaw_rad)
        began, began_yaw_rad = self._began
        self._window.add(scene, then, yaw_rad)
        plants = self._window.plants
        moved_m = math.inf if self._looked is None else _measure(self._looked, then)
        is_new = len(plants) != self.seen and _measure(began, then) < LOOK_M
        if len(plants) < FEWEST or not (is_new or moved_m >= LOOK_M):
            return False
        self.seen, self._looked = len(plants), then
        here = np.array([then.x_m, then.y_m])
        seen = SeenPlants(plants - here, self._window.ground - here)
        prior = self._carry(then, yaw_rad, began, began_yaw_rad) if self._before else start
        self.places = find_places(self._plants, seen, around, turns_rad, prior)
        if _measure(began, then) >= PIECE_M:
            self._before, self._began = self.places, (then, yaw_rad)
            self._window.cut()
        return True

    def _carry(self, then: Motion, yaw_rad: float, began: Motion, began_yaw_rad: float) -> Prior:
        """Make a prior of the places at the end of the last piece, moved along with the robot.

        What has been corrected of the heading since is no longer missing in their turns.
        """
        way_m = then.x_m - began.x_m, then.y_m - began.y_m
        corrected_rad = wrap_rad(yaw_rad - began_yaw_rad - (then.yaw_rad - began.yaw_rad))
        poses = [
            Pose2(place.x_map_m, place.y_map_m, place.turn_rad - corrected_rad)
            for place in self._before
        ]
        at = np.array([pose.transform(*way_m) for pose in poses])
        turns_rad = np.array([pose.yaw_rad for pose in poses])
        share = np.array([place.share for place in self._before])
        lost = LOST_RATIO * float(share.max())

        def prior(x_m: FloatArray, y_m: FloatArray, turn_rad: FloatArray) -> FloatArray:
            off_m = np.hypot(x_m[:, None] - at[:, 0], y_m[:, None] - at[:, 1])
            off2 = (off_m / PIECE_STD_M) ** 2
            off2 += ((turn_rad[:, None] - turns_rad) / PIECE_STD_RAD) ** 2
            near = share * np.exp(-off2 / 2.0)
            log: FloatArray = np.log(near.max(axis=1) + lost)
            return log

        return prior


def _measure(a: Motion, b: Motion) -> float:
    return math.hypot(b.x_m - a.x_m, b.y_m - a.y_m)
