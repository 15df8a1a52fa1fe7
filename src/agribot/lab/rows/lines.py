"""Labelled rows as straight lines of the picture, and the camera that they show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.ground import GroundLookup, ground_to_pixels
from agribot.autonomy.perceive.pictures import PictureClasses
from agribot.autonomy.perceive.row_line import find_row_line
from agribot.core.messages import FloatArray, RowLine
from agribot.core.pose import Pose2
from agribot.core.robot import CameraSpec
from agribot.lab.rows.labelled import SIDE_PX, TOP_PX, Mask, find_crossings

JUDGED_AT_PX = 2.0 * SIDE_PX / 3.0  # picture row at which lines are compared
MIDDLE_PX = (SIDE_PX - 1) / 2.0
LEAST_ROWS = 24  # picture rows that a line crosses
FOLLOW_PX = 14.0  # farthest step of a line from one picture row to the next
# A photograph says neither the size nor the angle of what it shows: rows are supposed to be so far
# apart, and lenses to be so wide. Other values move the camera nearer or farther, not the line.
ROW_SPACING_M, LENS_RAD = 0.5, math.radians(60.0)
HIGHEST_HORIZON_PX = -40.0 * SIDE_PX  # of a camera that looks straight down
LOWEST_HORIZON_PX = MIDDLE_PX - 1.0
NEAREST_GROUND_M = 0.41  # ahead of the robot at the lower edge, as of the packaged robot
MOST_RANGE_M = 4.0
ALONG_M = np.array([-0.2, 0.2])  # points of a line on the ground that are projected
SPACING_STEP = 1.05  # ratio of spacings that are looked at as one camera


class PictureLine(NamedTuple):
    """A line u_px = at_px + slope * (v_px - JUDGED_AT_PX), u right and v down."""

    at_px: float
    slope: float

    @property
    def angle_rad(self) -> float:
        """Angle from upright, positive where the line runs to the right on its way down."""
        return math.atan(self.slope)


class PhotoCamera(NamedTuple):
    """A camera over level ground: its picture row of the horizon, and how far apart it shows rows.

    `spacing_px` is the distance of neighbouring rows in the picture row JUDGED_AT_PX.
    """

    horizon_px: float
    spacing_px: float


def trace_lines(lines: Mask) -> list[PictureLine]:
    """Trace the labelled lines of a picture, from left to right."""
    tracks: list[list[tuple[int, float]]] = []
    for v_px in range(TOP_PX, len(lines)):
        for first, last in find_crossings(lines[v_px]):
            # The picture's edge cuts a line aslant, and its middle is not known there.
            if first > 0 and last < lines.shape[1] - 1:
                _follow(tracks, v_px, (first + last) / 2.0)
    found = [_fit(track) for track in tracks if len(track) >= LEAST_ROWS]
    return sorted(found)


def _follow(tracks: list[list[tuple[int, float]]], v_px: int, u_px: float) -> None:
    """Add a crossing to the line that ends beside it, or begin a line."""
    for track in tracks:
        last_v_px, last_u_px = track[-1]
        if 0 < v_px - last_v_px <= 2 and abs(u_px - last_u_px) <= FOLLOW_PX:
            track.append((v_px, u_px))
            return
    tracks.append([(v_px, u_px)])


def _fit(track: Sequence[tuple[int, float]]) -> PictureLine:
    v_px, u_px = np.array(track, dtype=float).T
    slope, at_px = np.polyfit(v_px - JUDGED_AT_PX, u_px, 1).tolist()
    return PictureLine(at_px, slope)


class PhotoCameras:
    """The cameras of a set of pictures, as their rows show them.

    Rows are parallel, so that their lines meet on the horizon. It is that of all pictures; how far
    apart the rows are, each picture shows itself where it has two.
    """

    def __init__(self, pictures: Sequence[Sequence[PictureLine]]) -> None:
        gaps = [_measure_gaps(lines) for lines in pictures]
        self._all = _fit_camera(np.concatenate(gaps)) if any(map(len, gaps)) else None

    def find(self, lines: Sequence[PictureLine]) -> PhotoCamera | None:
        """Find the camera of a picture by its lines; None where no picture shows two rows."""
        gaps = _measure_gaps(lines)
        if self._all is None or not len(gaps):
            return self._all
        return self._all._replace(spacing_px=float(np.median(gaps[:, 0])))


def _fit_camera(gaps: FloatArray) -> PhotoCamera:
    at_px, wider = gaps.T
    horizon_px = float(np.median(JUDGED_AT_PX - at_px / np.maximum(wider, 1e-6)))
    horizon_px = min(max(horizon_px, HIGHEST_HORIZON_PX), LOWEST_HORIZON_PX)
    return PhotoCamera(horizon_px, float(np.median(at_px)))


def _measure_gaps(lines: Sequence[PictureLine]) -> FloatArray:
    """Measure how far apart neighbouring lines are, and how much farther with each picture row."""
    return np.array(
        [(max(b.at_px - a.at_px, 1.0), b.slope - a.slope) for a, b in pairwise(lines)]
    ).reshape(-1, 2)


class LineFinder:
    """Finds the row line in photographs as the robot finds it."""

    def __init__(self) -> None:
        self._views: dict[PhotoCamera, PhotoGround] = {}

    def find(self, classes: PictureClasses, camera: PhotoCamera) -> PictureLine | None:
        """Find the line in the classes (SIDE_PX, SIDE_PX) of a picture."""
        rounded = camera._replace(spacing_px=SPACING_STEP ** round(
            math.log(camera.spacing_px) / math.log(SPACING_STEP)
        ))  # fmt: skip
        if rounded not in self._views:
            self._views[rounded] = PhotoGround(rounded)
        return self._views[rounded].find(classes)


class PhotoGround:
    """The ground before one camera."""

    def __init__(self, camera: PhotoCamera) -> None:
        spec = CameraSpec(
            link="camera", width_px=SIDE_PX, height_px=SIDE_PX, hfov_rad=LENS_RAD, rate_hz=1.0,
            noise_std=0.0, clip_near_m=0.01, clip_far_m=100.0,
        )  # fmt: skip
        self._k_px = spec.matrix()
        self._body_from_camera = _mount(camera, spec.focal_px)
        shape = (SIDE_PX, SIDE_PX)
        self._ground = GroundLookup(spec, self._body_from_camera, shape, MOST_RANGE_M)

    def find(self, classes: PictureClasses) -> PictureLine | None:
        """Find the line in the classes (SIDE_PX, SIDE_PX) of a picture."""
        class_map = ClassMap(
            class_id=classes.class_id, confidence=classes.confidence, scale_px=(1.0, 1.0)
        )
        row = find_row_line(class_map, self._ground, 0.0)
        return None if row is None else self._project(row)

    def _project(self, row: RowLine) -> PictureLine | None:
        if row.offset_m is None or row.heading_rad is None:
            return None
        seen_from = Pose2(row.at_ahead_m, 0.0, -row.heading_rad)
        ground_m = np.column_stack(seen_from.transform(ALONG_M, np.full(2, -row.offset_m)))
        u_px, v_px = ground_to_pixels(ground_m, self._k_px, self._body_from_camera).T
        slope = float((u_px[1] - u_px[0]) / (v_px[1] - v_px[0]))
        return PictureLine(float(u_px[0] + slope * (JUDGED_AT_PX - v_px[0])), slope)


def _mount(camera: PhotoCamera, focal_px: float) -> FloatArray:
    """Make the pose (4, 4) of a camera in the body frame."""
    pitch_rad = math.atan((MIDDLE_PX - camera.horizon_px) / focal_px)
    below_px = (MIDDLE_PX - camera.horizon_px) / (JUDGED_AT_PX - camera.horizon_px)
    height_m = ROW_SPACING_M * focal_px * math.sin(pitch_rad) / (camera.spacing_px * below_px)
    ahead_m = NEAREST_GROUND_M - height_m / math.tan(pitch_rad + LENS_RAD / 2.0)
    sin, cos = math.sin(pitch_rad), math.cos(pitch_rad)
    return np.array(
        [[0.0, -sin, cos, ahead_m], [-1.0, 0.0, 0.0, 0.0], [0.0, -cos, -sin, height_m],
         [0.0, 0.0, 0.0, 1.0]]
    )  # fmt: skip


class LineScores:
    """Found lines against labelled ones: `add` picture by picture."""

    def __init__(self) -> None:
        self._pictures = 0
        self._angles_rad: list[float] = []
        self._offset_ratios: list[float] = []

    def add(
        self, labelled: Sequence[PictureLine], camera: PhotoCamera, found: PictureLine | None
    ) -> None:
        """Compare a found line with the labelled row that is nearest to it."""
        if not labelled:
            return
        self._pictures += 1
        if found is not None:
            nearest = min(labelled, key=lambda line: abs(line.at_px - found.at_px))
            self._angles_rad.append(abs(found.angle_rad - nearest.angle_rad))
            self._offset_ratios.append(abs(found.at_px - nearest.at_px) / camera.spacing_px)

    def summarise(self) -> dict[str, float | None]:
        """Return the share of pictures with a found line, and the errors of these lines."""
        found = len(self._angles_rad) / self._pictures if self._pictures else None
        angles_deg = np.degrees(self._angles_rad)
        return {
            "found": found,
            "angle_deg_median": float(np.median(angles_deg)) if found else None,
            "angle_deg_p95": float(np.percentile(angles_deg, 95)) if found else None,
            "offset_ratio_median": float(np.median(self._offset_ratios)) if found else None,
        }
