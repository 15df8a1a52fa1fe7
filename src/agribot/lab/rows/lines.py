"""Labelled rows as straight lines of the picture, and the camera that they show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.far_view import FOLIAGE_M
from agribot.autonomy.perceive.ground import GroundLookup, ground_to_pixels
from agribot.autonomy.perceive.pictures import PictureClasses
from agribot.autonomy.perceive.row_line import SeenRowLine, see_row_line
from agribot.autonomy.perceive.row_names import name_by_rows
from agribot.core.geo import rotation_from_rpy
from agribot.core.messages import ByteArray, FloatArray
from agribot.core.pose import Pose2
from agribot.core.robot import CameraSpec
from agribot.lab.rows.labelled import SIDE_PX, TOP_PX, Mask, find_crossings

JUDGED_AT_PX = 2.0 * SIDE_PX / 3.0  # picture row at which lines are compared
MIDDLE_PX = (SIDE_PX - 1) / 2.0
LEAST_ROWS = 24  # picture rows that a line crosses
FOLLOW_PX = 14.0  # farthest step of a line from one picture row to the next
# A photograph states neither the size nor the angle of what it shows: this row spacing and lens
# angle are assumed. Other values move the camera nearer or farther, not the line.
# The finder gets the spacing, as a robot knows that of its field.
ROW_SPACING_M, LENS_RAD = 0.5, math.radians(60.0)
HIGHEST_HORIZON_PX = -40.0 * SIDE_PX  # horizon of a camera that looks straight down
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


class FoundLine(NamedTuple):
    """A line that was found, with 1 sigma of its angle and of its place at JUDGED_AT_PX."""

    line: PictureLine
    angle_std_rad: float
    at_std_px: float


class NamedPicture(NamedTuple):
    """The line that was found in a picture, if any, and the classes that rows and looks give."""

    line: FoundLine | None
    classes: PictureClasses


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
    """Finds the row line in photographs, and names plants by it, as the robot does."""

    def __init__(self) -> None:
        self._views: dict[PhotoCamera, PhotoGround] = {}

    def find(
        self, classes: PictureClasses, camera: PhotoCamera, image_rgb: ByteArray | None = None
    ) -> NamedPicture:
        """Find the line in a picture (SIDE_PX, SIDE_PX, 3) and its classes (SIDE_PX, SIDE_PX)."""
        rounded = camera._replace(spacing_px=SPACING_STEP ** round(
            math.log(camera.spacing_px) / math.log(SPACING_STEP)
        ))  # fmt: skip
        if rounded not in self._views:
            self._views[rounded] = PhotoGround(rounded)
        return self._views[rounded].find(classes, image_rgb)


class PhotoGround:
    """The ground before one camera."""

    def __init__(self, camera: PhotoCamera) -> None:
        spec = CameraSpec(
            link="camera", width_px=SIDE_PX, height_px=SIDE_PX, hfov_rad=LENS_RAD, rate_hz=1.0,
            noise_std=0.0, clip_near_m=0.01, clip_far_m=100.0,
        )  # fmt: skip
        self._k_px = spec.matrix()
        self._body_from_camera = _mount(camera, spec.focal_px)
        height_m = float(self._body_from_camera[2, 3])
        # Factor by which foliage seems farther away than it is.
        self._farther = height_m / (height_m - FOLIAGE_M)
        shape = (SIDE_PX, SIDE_PX)
        self._ground = GroundLookup(
            spec, self._body_from_camera, shape, MOST_RANGE_M, ROW_SPACING_M / self._farther
        )

    def find(self, classes: PictureClasses, image_rgb: ByteArray | None) -> NamedPicture:
        """Find the line in a picture (SIDE_PX, SIDE_PX, 3) and its classes (SIDE_PX, SIDE_PX)."""
        class_map = ClassMap(
            class_id=classes.class_id, confidence=classes.confidence, scale_px=(1.0, 1.0)
        )
        seen = see_row_line(class_map, self._ground, 0.0, image_rgb)
        if seen is None or seen.line.offset_m is None or seen.line.heading_rad is None:
            return NamedPicture(None, classes)
        line = self._measure(seen, seen.line.offset_m, seen.line.heading_rad)
        if seen.far is None:
            return NamedPicture(line, classes)
        named = name_by_rows(class_map, self._ground, seen.far, image_rgb)
        return NamedPicture(line, PictureClasses(named.class_id, named.confidence))

    def _measure(self, seen: SeenRowLine, offset_m: float, heading_rad: float) -> FoundLine:
        """Project the line, and the two lines that are off it by one sigma."""
        line = self._project(seen, offset_m, heading_rad)
        moved = self._project(seen, offset_m + seen.line.offset_std_m, heading_rad)
        turned = self._project(seen, offset_m, heading_rad + seen.line.heading_std_rad)
        return FoundLine(
            line,
            math.hypot(moved.angle_rad - line.angle_rad, turned.angle_rad - line.angle_rad),
            math.hypot(moved.at_px - line.at_px, turned.at_px - line.at_px),
        )

    def _project(self, seen: SeenRowLine, offset_m: float, heading_rad: float) -> PictureLine:
        """Project the leaves on a line into the picture of a camera that is tilted."""
        seen_from = Pose2(seen.line.at_ahead_m, 0.0, -heading_rad)
        leaves_m = np.column_stack(seen_from.transform(ALONG_M, np.full(2, -offset_m)))
        camera_m = self._body_from_camera[:2, 3]
        ground_m = camera_m + self._farther * (leaves_m - camera_m)
        body_from_camera = self._body_from_camera.copy()
        body_from_camera[:3, :3] = (
            rotation_from_rpy(0.0, seen.tilt_rad, 0.0) @ body_from_camera[:3, :3]
        )
        u_px, v_px = ground_to_pixels(ground_m, self._k_px, body_from_camera).T
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
        self._is_within: list[tuple[bool, bool]] = []

    def add(
        self, labelled: Sequence[PictureLine], camera: PhotoCamera, found: FoundLine | None
    ) -> None:
        """Compare a found line with the labelled row that is nearest to it."""
        if not labelled:
            return
        self._pictures += 1
        if found is not None:
            line = found.line
            nearest = min(labelled, key=lambda one: abs(one.at_px - line.at_px))
            turned_rad, off_px = line.angle_rad - nearest.angle_rad, line.at_px - nearest.at_px
            self._angles_rad.append(abs(turned_rad))
            self._offset_ratios.append(abs(off_px) / camera.spacing_px)
            self._is_within.append(
                (abs(turned_rad) <= 2.0 * found.angle_std_rad, abs(off_px) <= 2.0 * found.at_std_px)
            )

    def summarise(self) -> dict[str, float | None]:
        """Return the share of pictures with a found line, and the errors of these lines.

        `..._within_2_sigma` are the shares of lines that are off by at most twice what they state.
        """
        found = len(self._angles_rad) / self._pictures if self._pictures else None
        angles_deg = np.degrees(self._angles_rad)
        within = np.mean(self._is_within, axis=0).tolist() if found else (None, None)
        return {
            "found": found,
            "angle_deg_median": float(np.median(angles_deg)) if found else None,
            "angle_deg_p95": float(np.percentile(angles_deg, 95)) if found else None,
            "offset_ratio_median": float(np.median(self._offset_ratios)) if found else None,
            "angle_within_2_sigma": within[0],
            "offset_within_2_sigma": within[1],
        }
