"""Crop plants that the camera sees, as corrections of the pose: they stand on known rows.

One plant on a row shows the error of the pose across the row; several, or one seen from two places,
show the error of the heading too. Where the field states its plant spacing, or a row's end is in
view, plants also show the place along the row. Rows look alike: a pose that is off by half a pitch
matches the wrong one, so plants are used only while the pose can distinguish rows.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import NamedTuple

from agribot.autonomy.estimate.filter.ekf import ROW_OFFSET, YAW, Row, X, Y
from agribot.autonomy.estimate.filter.field_rows import RowFrame, find_slot
from agribot.autonomy.estimate.filter.gate import Gate, Verdict
from agribot.autonomy.estimate.filter.history import Epoch, Motion
from agribot.autonomy.estimate.filter.measurement import Measurement
from agribot.autonomy.estimate.filter.row_model import DISTINCT_ROWS_RATIO as TELLS_ROWS_APART_RATIO
from agribot.autonomy.estimate.sensors.correction import Correction, Measurements
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.autonomy.estimate.witnesses.contradiction import Contradiction
from agribot.core.messages import GroundPlant, PlantClass, Scene
from agribot.core.pose import Pose2

# A drill sets plants about this far off their line, and off their place in it.
PLANTING_STD_M = 0.02
# Pitch and roll of the robot shift all plants of a frame together: 0.3 degrees at 1.3 m.
FRAME_STD_M = 0.015
# Distance, not frames, brings new information: the network's error on a plant changes soon as the
# robot moves, the plant's offset from its place only once the plant has passed by.
LOOK_MEMORY_M, PLANTING_MEMORY_M = 0.05, 0.4
MIN_MOVED_M = 0.005
# Largest 1 sigma of a pose that distinguishes plants of a row, as a share of their distance.
DISTINCT_PLANTS_RATIO = 0.2
# Fragments of weeds taken for crop are smaller than the crop of the field by far.
MIN_SIZE_RATIO, SIZE_WEIGHT = 0.2, 0.1
# Least weight of a small plant, so that a few giants cannot shut out the crop.
SMALL_WEIGHT = 0.002
# A plant farther outside the rows than this belongs to no row.
BEYOND_M = 0.6
# A row ends where nothing more grows for this long within the view.
END_GAP_M = 0.4
END_STD_M = 0.05
RECOVERY_YAW_RAD = math.radians(3.0)


class CropSighting(NamedTuple):
    """A crop in the map as the filter places it; `lever_m` is its offset from the pose's anchor.

    `std_m` is the error of this one look, `variance_m2` the larger one that makes looks at the
    same plant together no better than they are.
    """

    plant: GroundPlant
    at: RowFrame
    lever_m: tuple[float, float]
    std_m: float
    variance_m2: float


class Viewpoint(NamedTuple):
    """Pose of the body at the capture, and the way since the last frame."""

    pose: Pose2
    moved_m: float


class CropRows(Correction[Scene]):
    """Corrects the filter by the crops of each scene."""

    def __init__(self, pose: PoseFilter) -> None:
        super().__init__(pose)
        # Too many rejections are overruled by the contradiction of several plants, not by a run.
        self._gate = Gate(pose.config.row_gate_sigma, outlier="crop off its row")
        self._end_gate = Gate(pose.config.row_gate_sigma, outlier="row end elsewhere")
        self._contradiction = Contradiction()
        self._last: Motion | None = None
        self._crop_area_m2 = 0.0
        self.fitted = 0  # pictures with crop that stands on the row under the robot
        self._seen_t_s = -math.inf

    def measure(self, sample: Scene, epoch: Epoch) -> Measurements:
        last, self._last = self._last, epoch.then
        if last is None:
            self.pose.rejected["scene first"] += 1
            return
        moved_m = math.hypot(epoch.then.x_m - last.x_m, epoch.then.y_m - last.y_m)
        if moved_m < MIN_MOVED_M:
            self._last = last  # creeping adds up to a move
            return
        self._seen_t_s = sample.t_s
        crops = self._crops(sample)
        accepted: list[CropSighting] = []
        for plant in crops:
            sighting = self._place(plant, self._view(epoch, moved_m), epoch, len(crops))
            if (yield from self._correct(sighting)):
                accepted.append(sighting)
        view = self._view(epoch, moved_m)
        self.fitted += self._is_own_row(accepted, view)
        if accepted and self.pose.rows.spacing_m is None:
            yield from self._correct_by_ends(accepted, sample, view)

    def _is_own_row(self, crops: list[CropSighting], view: Viewpoint) -> bool:
        """Whether one stands on the row that the robot drives over, not on one beside it."""
        row = self.pose.rows.at(view.pose.x_m, view.pose.y_m).row
        return any(crop.at.row == row for crop in crops)

    def _crops(self, scene: Scene) -> list[GroundPlant]:
        """List the crops of a scene without those far too small, nearest first."""
        crops = []
        for plant in sorted(
            (p for p in scene.plants if p.plant is PlantClass.CROP), key=lambda p: -p.area_m2
        ):
            if not math.isfinite(plant.x_body_m + plant.y_body_m + plant.std_m + plant.area_m2):
                self.pose.rejected["crop not finite"] += 1
            elif plant.area_m2 < MIN_SIZE_RATIO * self._crop_area_m2:
                self.pose.rejected["crop too small"] += 1
                self._crop_area_m2 += SMALL_WEIGHT * (plant.area_m2 - self._crop_area_m2)
            else:
                change_m2 = plant.area_m2 - self._crop_area_m2
                weight = SIZE_WEIGHT if self._crop_area_m2 else 1.0
                self._crop_area_m2 += weight * change_m2
                crops.append(plant)
        return sorted(crops, key=lambda p: math.hypot(p.x_body_m, p.y_body_m))

    def _view(self, epoch: Epoch, moved_m: float) -> Viewpoint:
        return Viewpoint(self.pose.place(epoch), moved_m)

    def _place(
        self, plant: GroundPlant, view: Viewpoint, epoch: Epoch, together: int
    ) -> CropSighting:
        then, now, _ = epoch
        arm_x, arm_y = view.pose.rotate(plant.x_body_m, plant.y_body_m)
        at = self.pose.rows.at(view.pose.x_m + arm_x, view.pose.y_m + arm_y)
        lever_m = (arm_x - (now.x_m - then.x_m), arm_y - (now.y_m - then.y_m))
        look_m2 = plant.std_m**2 + together * FRAME_STD_M**2
        variance_m2 = look_m2 * _repeats(LOOK_MEMORY_M, view.moved_m)
        variance_m2 += PLANTING_STD_M**2 * _repeats(PLANTING_MEMORY_M, view.moved_m)
        std_m = math.sqrt(look_m2 + PLANTING_STD_M**2)
        return CropSighting(plant, at, lever_m, std_m, variance_m2)

    def _correct(self, seen: CropSighting) -> Generator[Measurement, Verdict, bool]:
        """Use one crop, across the row and where possible along it; False: it does not fit."""
        at = seen.at
        if not -BEYOND_M <= at.along_m <= at.length_m + BEYOND_M:
            self.pose.rejected["crop beyond the rows"] += 1
            return False
        self.pose.look_at_rows()
        across: Row = (*_row(at.right, seen.lever_m), (ROW_OFFSET, -1.0))
        across_m2 = self.pose.ekf.project(across)[1]
        if across_m2 > (TELLS_ROWS_APART_RATIO * at.pitch_m) ** 2:
            self.pose.rejected["row ambiguous"] += 1
            return False
        off_m = at.off_m + self.pose.ekf.x[ROW_OFFSET]
        ahead = self._ahead(seen)
        verdict = yield Measurement(
            (off_m,) if ahead is None else (off_m, ahead[1]),
            (across,) if ahead is None else (across, ahead[0]),
            seen.std_m**2, self._gate, lasting_variance=seen.variance_m2,
        )  # fmt: skip
        if verdict == "accept":
            self._contradiction.settle()
            self.pose.agreement.hold(self._seen_t_s)
            return True
        yield from self._recover(seen, across, off_m)
        return False

    def _ahead(self, seen: CropSighting) -> tuple[Row, float] | None:
        """Distance ahead of the plant's place in its row, where the pose determines that place."""
        at, spacing_m = seen.at, self.pose.rows.spacing_m
        if spacing_m is None:
            return None
        along = _row(at.forward, seen.lever_m)
        if self.pose.ekf.project(along)[1] > (DISTINCT_PLANTS_RATIO * spacing_m) ** 2:
            return None
        return along, (find_slot(at, spacing_m)[1] - at.along_m) * at.stretch

    def _recover(self, seen: CropSighting, across: Row, off_m: float) -> Measurements:
        """Correct the pose where plant after plant is off by the same amount."""
        wrong_m = self._contradiction.add(seen.at.along_m, seen.at.right_m, off_m)
        if wrong_m is None:
            return
        self.pose.agreement.testify(self._seen_t_s, wrong_m)
        self.pose.rejected["rows found again"] += 1
        right_x, right_y = seen.at.right
        yield Measurement(
            (off_m,), (across,), seen.std_m**2,
            opens=(
                (X, (wrong_m * right_x) ** 2), (Y, (wrong_m * right_y) ** 2),
                (YAW, RECOVERY_YAW_RAD**2),
            ),
        )  # fmt: skip

    def _correct_by_ends(
        self, crops: list[CropSighting], scene: Scene, view: Viewpoint
    ) -> Measurements:
        """Find the row's end: the outermost plant in view, with bare ground after it."""
        for row in sorted({crop.at.row for crop in crops}):
            mine = [crop for crop in crops if crop.at.row == row]
            for sign, end_m in ((1.0, mine[0].at.length_m), (-1.0, 0.0)):
                last = max(mine, key=lambda crop: sign * crop.at.along_m)
                off_m = (end_m - last.at.along_m) * last.at.stretch
                along = _row(last.at.forward, last.lever_m)
                if abs(off_m) <= BEYOND_M and self._sees_beyond(last, sign, scene, view):
                    yield Measurement(
                        (off_m,), (along,), math.hypot(last.std_m, END_STD_M) ** 2, self._end_gate,
                        lasting_variance=last.variance_m2 + END_STD_M**2,
                    )  # fmt: skip

    def _sees_beyond(self, crop: CropSighting, sign: float, scene: Scene, view: Viewpoint) -> bool:
        """Whether the view holds the ground at the end gap after a plant."""
        forward_x, forward_y = crop.at.forward
        gap_x, gap_y = sign * END_GAP_M * forward_x, sign * END_GAP_M * forward_y
        x_m = crop.plant.x_body_m + view.pose.cos * gap_x + view.pose.sin * gap_y
        y_m = crop.plant.y_body_m - view.pose.sin * gap_x + view.pose.cos * gap_y
        return _holds(scene.view_body_m, x_m, y_m)


def _repeats(memory_m: float, moved_m: float) -> float:
    """Count the frames that share one lasting error; their noise has to count that often."""
    return max(2.0 * memory_m / moved_m, 1.0)


def _row(direction: tuple[float, float], lever_m: tuple[float, float]) -> Row:
    """Make the row of a measurement: a place that the pose carries along, in a direction."""
    dx, dy = direction
    return ((X, dx), (Y, dy), (YAW, dy * lever_m[0] - dx * lever_m[1]))


def _holds(polygon: tuple[tuple[float, float], ...], x_m: float, y_m: float) -> bool:
    """Whether a convex polygon holds a point, whichever way it runs round."""
    if len(polygon) < 3:
        return False
    sides = [
        (bx - ax) * (y_m - ay) - (by - ay) * (x_m - ax)
        for (ax, ay), (bx, by) in zip(polygon, polygon[1:] + polygon[:1], strict=True)
    ]
    return min(sides) >= 0.0 or max(sides) <= 0.0
