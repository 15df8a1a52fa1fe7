"""Crop plants that an earlier run mapped, as corrections of the pose: they stand where they stood.

Along the rows they give the place as a receiver with carrier corrections would. Where they put the
robot in another row, or elsewhere in the row, the pose follows them before the robot has moved, and
under way a person is asked. Without any position they give the first one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from agribot.autonomy.estimate.filter.ekf import YAW, X, Y
from agribot.autonomy.estimate.filter.field_rows import RowFrame
from agribot.autonomy.estimate.filter.gate import Gate
from agribot.autonomy.estimate.filter.history import Epoch
from agribot.autonomy.estimate.filter.measurement import Measurement
from agribot.autonomy.estimate.filter.stem_map import StemMap
from agribot.autonomy.estimate.sensors.correction import Correction, Measurements
from agribot.autonomy.estimate.sensors.plant_belief import LOOK_M, PlantBelief
from agribot.autonomy.estimate.sensors.plant_match import MatchedPlace, Prior
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.autonomy.estimate.sensors.row_lines import moved_row
from agribot.core.facts import PlantsElsewhere
from agribot.core.geo import wrap_rad
from agribot.core.messages import FloatArray, Scene
from agribot.core.pose import Pose2

# Probability and number of plants that make a place sure.
SURE, FEWEST_SURE = 0.999, 8
# Probability of a place from which its row counts.
ROW_PROBABILITY = 0.99
# Offset from the pose, m and in sigmas, up to which plants are in place; offset along the row up to
# which the pose follows them unasked.
HERE_M, HERE_SIGMA, ALONG_M = 0.12, 3.5, 1.0
# A robot may be two rows aside of where it is believed to be, or that far along.
ROWS_ASIDE, LEAST_REACH_M = 2.3, 1.5
# Against the likeliest place along the row, one anywhere else that is looked at.
FAR_RATIO, LEAST_ALONG_M = 1e-3, 0.1
# 1 sigma of the mapped place of plants and looks at them, and the way over which errors last.
STD_M, MEMORY_M = 0.03, 1.0
# Headings are tried in such steps, where the heading is known worse than that.
TURN_RAD, MOST_TURNS = math.radians(1.5), 8
YAW_STD_RAD = math.radians(1.0)
# Way at the start within which the robot follows the plants.
STARTS_M = 0.3


class PlantPlaces(Correction[Scene]):
    """`take_plants` gives it the map; without one it says nothing."""

    needs = "yaw"

    def __init__(self, pose: PoseFilter) -> None:
        super().__init__(pose)
        self._gate = Gate(pose.config.gate_sigma, pose.config.recover_after, "plants off the map")
        self._belief: PlantBelief | None = None
        self._elsewhere: tuple[MatchedPlace, Epoch] | None = None  # under way
        self._moved_m = 0.0
        self.found = 0  # times that the pose was set by the plants

    @property
    def has_plants(self) -> bool:
        return self._belief is not None

    def take_plants(self, plants: StemMap) -> None:
        self._belief = PlantBelief(plants)

    def restart(self) -> None:
        """Forget what was seen: the robot may stand anywhere."""
        if self._belief is not None:
            self._belief.restart()
        self._elsewhere, self.pose.identity.elsewhere = None, None

    def accept(self) -> bool:
        """Go over to where the plants say that the robot is, if they do: a person has seen it."""
        if self._elsewhere is None:
            return False
        place, seen = self._elsewhere
        self._set(place, seen._replace(now=self.pose.history.newest or seen.now))
        return True

    def measure(self, sample: Scene, epoch: Epoch) -> Measurements:
        belief = self._belief
        if belief is None:
            return
        pose, is_known = self.pose.place(epoch), "position" in self.pose.known
        self._moved_m = math.hypot(epoch.then.x_m, epoch.then.y_m)
        here = self.pose.rows.at(*pose.xy_m)
        yaw_std_rad = math.sqrt(float(self.pose.ekf.cov[YAW, YAW]))
        turns = _list_turns(yaw_std_rad)
        along_m = max(self._project_std_m(here.forward), LEAST_ALONG_M) if is_known else None
        around = None if along_m is None else self._reach(pose, here, along_m)
        start = _expect(pose, here, along_m, yaw_std_rad)
        if not belief.add(sample, epoch.then, pose.yaw_rad, around, turns, start):
            return
        best = belief.places[0] if belief.places else None
        if best is None:
            return
        is_sure = best.share >= SURE and best.matched >= FEWEST_SURE
        if not is_known:
            if is_sure:
                self._set(best, epoch)
            return
        if best.share >= ROW_PROBABILITY and best.matched >= FEWEST_SURE:
            self.pose.identity.weigh(self._share_rows(belief.places, here, pose))
        if is_sure:
            yield from self._hold(best, pose, here, epoch)

    def _reach(self, pose: Pose2, here: RowFrame, along_m: float) -> tuple[float, float, float]:
        """Say where to look for the robot: in any row near by, but here along it."""
        pitch_m = here.pitch_m if math.isfinite(here.pitch_m) else 0.0
        return (*pose.xy_m, max(ROWS_ASIDE * pitch_m, LEAST_REACH_M, 3.0 * along_m))

    def _project_std_m(self, direction: tuple[float, float]) -> float:
        dx, dy = direction
        return math.sqrt(self.pose.ekf.project(((X, dx), (Y, dy)))[1])

    def _share_rows(
        self, places: list[MatchedPlace], here: RowFrame, pose: Pose2
    ) -> dict[int, float]:
        """Sum up how likely each number of rows to the right of the believed one is."""
        shares: dict[int, float] = {}
        for place in places:
            right_m = (place.x_map_m - pose.x_m) * here.right[0]
            right_m += (place.y_map_m - pose.y_m) * here.right[1]
            shift = round(right_m / here.pitch_m) if math.isfinite(here.pitch_m) else 0
            shares[shift] = shares.get(shift, 0.0) + place.share
        return shares

    def _hold(self, best: MatchedPlace, pose: Pose2, here: RowFrame, epoch: Epoch) -> Measurements:
        """Correct the pose along the row, or report that the robot is elsewhere."""
        off_m = best.x_map_m - pose.x_m, best.y_map_m - pose.y_m
        along_m = off_m[0] * here.forward[0] + off_m[1] * here.forward[1]
        right_m = off_m[0] * here.right[0] + off_m[1] * here.right[1]
        limits = [
            max(HERE_M, HERE_SIGMA * self._project_std_m(way)) for way in (here.forward, here.right)
        ]
        if abs(right_m) > min(limits[1], here.pitch_m / 2.0) or abs(along_m) > ALONG_M:
            self._report_elsewhere(best, along_m, right_m, epoch)
            return
        self._elsewhere, self.pose.identity.elsewhere = None, None
        yield Measurement(
            (along_m,), (moved_row(here.forward, epoch),), STD_M**2, self._gate,
            lasting_variance=STD_M**2 * 2.0 * MEMORY_M / LOOK_M,
            opens=tuple(
                (state, (part * along_m) ** 2)
                for state, part in zip((X, Y), here.forward, strict=True)
            ),
            must_open=abs(along_m) > limits[0],
        )  # fmt: skip

    def _report_elsewhere(
        self, best: MatchedPlace, along_m: float, right_m: float, epoch: Epoch
    ) -> None:
        if self._moved_m < STARTS_M:
            self._set(best, epoch)
            return
        self._elsewhere = best, epoch
        self.pose.identity.elsewhere = PlantsElsewhere(
            best.share, best.matched,
            abs(along_m) if abs(along_m) >= HERE_M else None,
            "ahead" if along_m > 0.0 else "behind",
            abs(right_m) if abs(right_m) >= HERE_M else None,
            "right" if right_m > 0.0 else "left",
        )  # fmt: skip

    def _set(self, place: MatchedPlace, epoch: Epoch) -> None:
        """Set the pose to a place at which the robot was when it saw the plants."""
        ekf, (then, now, _) = self.pose.ekf, epoch
        turned = Pose2(0.0, 0.0, place.turn_rad)
        moved_x_m, moved_y_m = turned.rotate(now.x_m - then.x_m, now.y_m - then.y_m)
        ekf.reset(X, place.x_map_m + moved_x_m, STD_M**2)
        ekf.reset(Y, place.y_map_m + moved_y_m, STD_M**2)
        if place.turn_rad or ekf.cov[YAW, YAW] > TURN_RAD**2:
            ekf.reset(YAW, wrap_rad(ekf.x[YAW] + place.turn_rad), TURN_RAD**2)
        self.pose.known.add("position")
        self.restart()
        self.found += 1


def _list_turns(yaw_std_rad: float) -> Sequence[float]:
    if yaw_std_rad <= YAW_STD_RAD:
        return (0.0,)
    steps = min(math.ceil(2.5 * yaw_std_rad / TURN_RAD), MOST_TURNS)
    return [step * TURN_RAD for step in range(-steps, steps + 1)]


def _expect(pose: Pose2, here: RowFrame, along_m: float | None, yaw_std_rad: float) -> Prior:
    """Make a prior of the pose: its heading and, where its place is known, that along the row.

    Rows look alike to the person who put the robot down, so all are equally likely.
    """

    def prior(x_m: FloatArray, y_m: FloatArray, turn_rad: FloatArray) -> FloatArray:
        log: FloatArray = -((turn_rad / yaw_std_rad) ** 2) / 2.0
        if along_m is None:
            return log
        off_m = (x_m - pose.x_m) * here.forward[0] + (y_m - pose.y_m) * here.forward[1]
        return log + np.log(np.exp(-((off_m / along_m) ** 2) / 2.0) + FAR_RATIO)

    return prior
