"""The line of the crop row before the robot, from a class map.

A camera that sees rows run away from it finds it by all rows in view (`far_row_line.py`). One that
looks down, or sees no rows far away, finds it by the crop near the robot: crop on the ground votes
for lines of every offset and heading; the slots along the best line are then fitted robustly.
Pixels serve where plants do not: dense crop closes to one piece that the picture's edge cuts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.far_row_line import FarLine, find_far_line, measure_far_contrast
from agribot.autonomy.perceive.far_view import FOLIAGE_M
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.core.messages import ByteArray, FloatArray, PlantClass, RowLine
from agribot.core.pose import Pose2

FAR_M = 2.1  # distance from the camera beyond which the network misses small crop
CELL_M = 0.025
# Distance ahead about which evidence is counted: offset and heading hardly depend on each other
# there.
PIVOT_AHEAD_M = 1.1
MAX_HEADING_RAD, HEADING_STEP_RAD = math.radians(25.0), math.radians(1.25)
MAX_OFFSET_M = 0.6
VOTE_CELLS = np.hanning(15)  # weights of a vote, as wide as a plant
FOLIAGE_STD_RATIO = 0.045  # 1 sigma of where foliage seems to lie aside, for its height
# The fit looks this far to both sides of the line, as far as big leaves reach.
WINDOW_M, PASSES = 0.3, 3
SLOT_M = 0.0625
FULL_SLOT_RATIO, MIN_SLOT_RATIO = 0.25, 0.04
HUBER_M = 0.1
MIN_SLOTS, MIN_SPAN_M, MIN_FILLED_RATIO = 8, 0.6, 0.5
# Crop all over the window, as a field of leaves has it, spreads by 0.17 m: that is no row. Nearly
# so wide, a row of big plants still has an edge on either side: within this of its middle is a
# strip of ground with at most this part of the crop that the middle has.
MAX_SCATTER_M, MAX_SPREAD_M, MAX_WIDE_SPREAD_M = 0.08, 0.145, 0.165
EDGE_M, EDGE_STEP_M, MIDDLE_M, EDGE_RATIO = 0.45, 0.05, 0.1, 0.5
# Neighbouring slots show the same plant, and no plant stands better on its line than this.
SLOTS_PER_PLANT, LEAST_SCATTER_M = 2.0, 0.02
# Roll and pitch of the robot shift and turn the whole picture.
TILT_STD_M, TILT_STD_RAD = 0.005, math.radians(0.4)
# A row starts or ends where nothing grows on its line for this length within the view: weeds may be
# misclassified crop.
END_GAP_M, END_BAND_M = 0.55, 0.15
RANGE_STD_M = 0.15


Mask = npt.NDArray[np.bool_]


class Growth(NamedTuple):
    """Cells of the ground with plants in them; `share` is how much of the cell they cover."""

    x_m: FloatArray
    y_m: FloatArray
    share: FloatArray


class Wedge(NamedTuple):
    """The ground whose foliage the picture holds: a wedge before the camera."""

    camera_x_m: float
    near_m: float
    far_m: float
    range_m: float
    side_m: float
    side_slope: float

    def holds(self, x_m: FloatArray, y_m: FloatArray) -> Mask:
        """Return which points (N,) of the body frame the picture shows."""
        inside: Mask = (x_m >= self.near_m) & (x_m <= self.far_m)
        inside &= np.hypot(x_m - self.camera_x_m, y_m) <= self.range_m
        inside &= np.abs(y_m) <= self.side_m + self.side_slope * (x_m - self.near_m)
        return inside


class Fit(NamedTuple):
    """A line through (x, y) of the body frame towards `yaw_rad`, with 1 sigma across and of yaw.

    At that place the two errors are independent.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    across_std_m: float = math.inf
    yaw_std_rad: float = math.inf

    @property
    def body_from_line(self) -> Pose2:
        return Pose2(self.x_m, self.y_m, self.yaw_rad)

    def along_left_m(self, plants: Growth) -> tuple[FloatArray, FloatArray]:
        """Resolve cells (N,): ahead of the place along the line, and to the left of the line."""
        return self.body_from_line.locate(plants.x_m, plants.y_m)

    def shows(self, view: Wedge, along_m: FloatArray, half_m: float) -> Mask:
        """Whether the view holds the line and `half_m` to both sides of it."""
        inside = np.ones(len(along_m), dtype=bool)
        for left_m in (-half_m, half_m):
            inside &= view.holds(*self.body_from_line.transform(along_m, left_m))
        return inside


class SeenRowLine(NamedTuple):
    """A row line, and the rows to the horizon by which it was found, if it was."""

    line: RowLine
    far: FarLine | None = None

    @property
    def tilt_rad(self) -> float:
        """Angle by which the camera was taken to look further down than described."""
        return self.far.tilt_rad if self.far else 0.0


def find_row_line(
    class_map: ClassMap, ground: GroundLookup, t_s: float, image_rgb: ByteArray | None = None
) -> RowLine | None:
    """Find the row line of a picture taken at `t_s`; None where there is too little to trust.

    `image_rgb` is the picture, whose green shows rows far away where the network sees no plants.
    """
    seen = see_row_line(class_map, ground, t_s, image_rgb)
    return None if seen is None else seen.line


def see_row_line(
    class_map: ClassMap, ground: GroundLookup, t_s: float, image_rgb: ByteArray | None = None
) -> SeenRowLine | None:
    """Find a row line as `find_row_line` does, with the rows far away that it is one of."""
    near = _find_near(class_map, ground, t_s)
    view = ground.far_view
    far = view and find_far_line(measure_far_contrast(class_map, image_rgb), view)
    if not far:
        return None if near is None else SeenRowLine(near)
    line = _make_line(_fit_far(far), t_s)
    if near is not None:  # ends of rows are seen near the robot alone
        line = msgspec.structs.replace(
            line, start_ahead_m=near.start_ahead_m, end_ahead_m=near.end_ahead_m
        )
    return SeenRowLine(line, far)


def _fit_far(far: FarLine) -> Fit:
    """Make the fit of a far line; how high its leaves stand is not known there either."""
    across_std_m = math.hypot(far.across_std_m, FOLIAGE_STD_RATIO * far.y_m)
    return Fit(far.x_m, far.y_m, far.yaw_rad, across_std_m, far.yaw_std_rad)


def _find_near(class_map: ClassMap, ground: GroundLookup, t_s: float) -> RowLine | None:
    """Find the row line by the crop within FAR_M."""
    crop = _growth(class_map, ground, class_map.class_id == PlantClass.CROP)
    if len(crop.x_m) < MIN_SLOTS:
        return None
    view = _view(ground)
    fit = _vote(crop)
    for _ in range(PASSES):
        fit = _refine(crop, fit, view) if fit is not None else None
    if fit is None or abs(fit.yaw_rad) > MAX_HEADING_RAD or not _is_row(crop, fit, view):
        return None
    plants = _growth(class_map, ground, class_map.class_id != PlantClass.SOIL)
    return _make_line(fit, t_s, *_ends(crop, plants, fit, view))


def _make_line(
    fit: Fit, t_s: float, start_m: float | None = None, end_m: float | None = None
) -> RowLine:
    return RowLine(
        t_s=t_s,
        offset_m=-fit.y_m / math.cos(fit.yaw_rad),
        heading_rad=-fit.yaw_rad,
        offset_std_m=fit.across_std_m,
        heading_std_rad=fit.yaw_std_rad,
        at_ahead_m=fit.x_m + fit.y_m * math.tan(fit.yaw_rad),
        start_ahead_m=start_m,
        end_ahead_m=end_m,
        range_std_m=RANGE_STD_M,
    )


def locate_foliage(ground: GroundLookup, seen: Mask) -> tuple[FloatArray, FloatArray]:
    """Locate the plants that the `seen` of the pixels show, (N,) each, ahead and to the left."""
    x_camera_m, y_camera_m = ground.camera_xyz_body_m[:2].tolist()
    nearer = _nearer(ground)
    return (
        x_camera_m + nearer * (ground.x_body_m[seen].astype(np.float64) - x_camera_m),
        y_camera_m + nearer * (ground.y_body_m[seen].astype(np.float64) - y_camera_m),
    )


def _nearer(ground: GroundLookup) -> float:
    return 1.0 - FOLIAGE_M / float(ground.camera_xyz_body_m[2])


def _view(ground: GroundLookup) -> Wedge:
    x_camera_m, nearer = float(ground.camera_xyz_body_m[0]), _nearer(ground)
    side = np.flatnonzero(ground.range_m[:, -1] <= FAR_M)
    top, bottom = (side[0], side[-1]) if len(side) else (0, -1)
    x_m = nearer * (ground.x_body_m[[bottom, top], -1].astype(np.float64) - x_camera_m)
    y_m = nearer * np.abs(ground.y_body_m[[bottom, top], -1].astype(np.float64))
    top_m = float(np.nanmin(ground.x_body_m[0])) if ground.area_m2[0].all() else math.inf
    return Wedge(
        x_camera_m,
        float(x_m[0]) + x_camera_m,
        nearer * (top_m - x_camera_m) + x_camera_m,
        nearer * FAR_M,
        float(y_m[0]),
        float((y_m[1] - y_m[0]) / max(x_m[1] - x_m[0], 1e-6)),
    )


def _growth(class_map: ClassMap, ground: GroundLookup, wanted: Mask) -> Growth:
    """Pixels within range as cells of the ground, moved to where their plants stand."""
    seen = wanted & (ground.range_m <= FAR_M)
    x_m, y_m = locate_foliage(ground, seen)
    area_m2 = _nearer(ground) ** 2 * ground.area_m2[seen].astype(np.float64)
    area_m2 *= class_map.confidence[seen] / 255.0
    along = np.floor(x_m / CELL_M).astype(np.int64)
    across = np.floor(y_m / CELL_M).astype(np.int64)
    cells, index = np.unique(along * 4096 + across + 2048, return_inverse=True)
    total_m2 = np.maximum(np.bincount(index, area_m2, len(cells)), 1e-12)
    return Growth(
        np.bincount(index, area_m2 * x_m, len(cells)) / total_m2,
        np.bincount(index, area_m2 * y_m, len(cells)) / total_m2,
        np.minimum(total_m2 / CELL_M**2, 1.0),
    )


def _vote(crop: Growth) -> Fit | None:
    """Find the offset and heading that most crop speaks for (a Hough transform)."""
    steps = round(MAX_HEADING_RAD / HEADING_STEP_RAD)
    yaws_rad = np.arange(-steps, steps + 1) * HEADING_STEP_RAD
    bins = 2 * round(MAX_OFFSET_M / CELL_M) + 1
    cos, sin = np.cos(yaws_rad)[:, None], np.sin(yaws_rad)[:, None]
    left_m = cos * crop.y_m[None, :] - sin * (crop.x_m - PIVOT_AHEAD_M)[None, :]
    at = np.rint((left_m + MAX_OFFSET_M) / CELL_M).astype(np.int64)
    inside = (at >= 0) & (at < bins)
    cell = at + bins * np.arange(len(yaws_rad))[:, None]
    share = np.broadcast_to(crop.share, at.shape)
    votes = np.bincount(cell[inside], share[inside], bins * len(yaws_rad)).reshape(-1, bins)
    smooth = np.apply_along_axis(np.convolve, 1, votes, VOTE_CELLS, "same")
    best = int(np.argmax(smooth))
    if smooth.flat[best] <= 0.0:
        return None
    row, column = divmod(best, bins)
    yaw_rad, offset_m = float(yaws_rad[row]), column * CELL_M - MAX_OFFSET_M
    return Fit(PIVOT_AHEAD_M - offset_m * math.sin(yaw_rad), offset_m * math.cos(yaw_rad), yaw_rad)


def _refine(crop: Growth, fit: Fit, view: Wedge) -> Fit | None:
    """Fit a robust straight line through the slots of the row that the view shows whole."""
    along_m, left_m = fit.along_left_m(crop)
    slot = np.floor(along_m / SLOT_M).astype(np.int64)
    begin_m: FloatArray = slot.astype(np.float64) * SLOT_M
    near = np.abs(left_m) <= WINDOW_M
    near &= fit.shows(view, begin_m, WINDOW_M)
    near &= fit.shows(view, begin_m + SLOT_M, WINDOW_M)
    slot, share, left_m = slot[near], crop.share[near], left_m[near]
    if not len(slot) or float(share @ left_m**2) > MAX_WIDE_SPREAD_M**2 * float(share.sum()):
        return None
    slot -= slot.min()
    filled = np.bincount(slot, share)
    full = 2.0 * WINDOW_M * SLOT_M / CELL_M**2
    enough = filled >= MIN_SLOT_RATIO * full
    if enough.sum() < MIN_SLOTS:
        return None
    u_m = np.bincount(slot, share * along_m[near])[enough] / filled[enough]
    v_m = np.bincount(slot, share * left_m)[enough] / filled[enough]
    weight = np.minimum(filled[enough] / (FULL_SLOT_RATIO * full), 1.0)
    off_m = np.abs(v_m - np.median(v_m))
    weight *= HUBER_M / np.maximum(off_m, HUBER_M)
    span_m = float(np.ptp(u_m))
    if span_m < MIN_SPAN_M or enough.sum() < MIN_FILLED_RATIO * (span_m / SLOT_M + 1.0):
        return None
    return _straight_line(fit, u_m, v_m, weight)


def _is_row(crop: Growth, fit: Fit, view: Wedge) -> bool:
    """Whether the crop about a line is a row, and not a field of leaves."""
    _, left_m = fit.along_left_m(crop)
    near = np.abs(left_m) <= WINDOW_M
    share = crop.share[near]
    is_narrow = float(share @ left_m[near] ** 2) <= MAX_SPREAD_M**2 * float(share.sum())
    return is_narrow or _has_edges(crop, fit, view)


def _has_edges(crop: Growth, fit: Fit, view: Wedge) -> bool:
    """Whether less crop stands to either side of a line than on it, as far as the view shows."""
    strips = 2 * round(EDGE_M / EDGE_STEP_M) + 1
    left_m = (np.arange(strips) - strips // 2) * EDGE_STEP_M
    along_m = np.arange(-FAR_M, FAR_M, SLOT_M)
    places = np.meshgrid(along_m, left_m)
    shown = view.holds(*fit.body_from_line.transform(*places)).sum(axis=1)
    cell_along_m, cell_left_m = fit.along_left_m(crop)
    strip = np.rint(cell_left_m / EDGE_STEP_M).astype(np.int64) + strips // 2
    inside = (strip >= 0) & (strip < strips) & view.holds(crop.x_m, crop.y_m)
    inside &= abs(cell_along_m) <= FAR_M
    grown = np.bincount(strip[inside], crop.share[inside], strips)
    density = np.where(shown >= MIN_SLOTS, grown / np.maximum(shown, 1), math.inf)
    middle = float(density[abs(left_m) <= MIDDLE_M].mean())
    sides = density[left_m > MIDDLE_M], density[left_m < -MIDDLE_M]
    return math.isfinite(middle) and all(side.min() <= EDGE_RATIO * middle for side in sides)


def _straight_line(fit: Fit, u_m: FloatArray, v_m: FloatArray, weight: FloatArray) -> Fit | None:
    """Make the line through points ahead along and left of another line."""
    total = float(weight.sum())
    along_m, left_m = float(weight @ u_m) / total, float(weight @ v_m) / total
    arm_m = u_m - along_m
    spread_m2 = float(weight @ arm_m**2)
    slope = float(weight @ (arm_m * (v_m - left_m))) / spread_m2
    rest_m = v_m - left_m - slope * arm_m
    scatter_m = math.sqrt(float(weight @ rest_m**2) / max(total - 2.0, 1.0))
    if scatter_m > MAX_SCATTER_M:
        return None
    x_m, y_m = fit.body_from_line.transform(along_m, left_m)
    plant_m2 = SLOTS_PER_PLANT * max(scatter_m, LEAST_SCATTER_M) ** 2
    return Fit(
        x_m,
        y_m,
        fit.yaw_rad + math.atan(slope),
        math.sqrt(plant_m2 / total + TILT_STD_M**2 + (FOLIAGE_STD_RATIO * y_m) ** 2),
        math.sqrt(plant_m2 / spread_m2 + TILT_STD_RAD**2),
    )


def _ends(crop: Growth, plants: Growth, fit: Fit, view: Wedge) -> tuple[float | None, float | None]:
    """Distances ahead of the first and the last plant of the row, if the view holds them."""
    _, left_m = fit.along_left_m(crop)
    mine = np.abs(left_m) <= WINDOW_M
    # Foliage is about as long as it is wide, and a disc's spread is half its radius.
    share = crop.share[mine]
    radius_m = 2.0 * math.sqrt(float(share @ left_m[mine] ** 2) / float(share.sum()))
    along_m, left_m = fit.along_left_m(plants)
    band = np.abs(left_m) <= END_BAND_M
    slot = np.floor((along_m[band] + 2.0 * FAR_M) / CELL_M).astype(np.int64)
    filled = np.bincount(slot, plants.share[band])
    grown = np.flatnonzero(filled >= MIN_SLOT_RATIO * 2.0 * END_BAND_M / CELL_M)
    steps_m = np.arange(-2.0 * FAR_M, 2.0 * FAR_M, CELL_M)
    shown_m = steps_m[fit.shows(view, steps_m, END_BAND_M)]
    if not len(grown) or not len(shown_m):
        return None, None
    first_m = float(grown[0]) * CELL_M - 2.0 * FAR_M
    last_m = float(grown[-1] + 1) * CELL_M - 2.0 * FAR_M
    # The body's origin lies this far ahead along the line.
    origin_m, _ = fit.body_from_line.locate(0.0, 0.0)
    is_start = first_m - float(shown_m[0]) >= END_GAP_M
    is_end = float(shown_m[-1]) - last_m >= END_GAP_M
    return (
        first_m + radius_m - origin_m if is_start else None,
        last_m - radius_m - origin_m if is_end else None,
    )
