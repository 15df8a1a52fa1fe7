"""Height, pitch and roll of a camera from pictures of rows whose distance is known.

Parallel rows meet on the horizon, which gives pitch and roll; their apparent spacing below it gives
the height. Each mount is judged by how well all pictures fit combs of rows of that distance, every
picture at its own heading and, on rough ground, at its own tilt. Where on the robot the camera
sits, and to which side it is turned, does not show.
Source: Hartley and Zisserman 2004, section 8.6 (vanishing points); Efron 1979 (bootstrap).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from agribot.autonomy.perceive.far_view import CELLS, FOLIAGE_M, FarView, RowGrid
from agribot.autonomy.perceive.ground import find_rays
from agribot.core.geo import LINK_FROM_OPTICAL, rotation_from_rpy
from agribot.core.messages import FloatArray
from agribot.core.robot import CameraSpec

PLANTS = 400.0  # independent ones as which a picture counts
UNIT_M = 1.0  # height of the camera at which combs are compared; their spacing gives the true one
HEIGHTS_M = (0.25, 2.5)
PITCHES_RAD = np.radians(np.arange(6.0, 67.0, 3.0))
YAWS_RAD, NEAR_YAWS_RAD = np.radians(np.arange(-30.0, 30.1, 3.0)), np.radians(np.arange(-6, 7, 2))
SPACINGS = 48
# Around the best of these, finely: steps of pitch, of spacing (a ratio), and of roll.
NEAR_RAD, NEAR_RATIO = np.radians(np.arange(-8.0, 8.1, 1.0)), np.geomspace(0.75, 1.33, 25)
ROLLS_RAD = np.radians(np.arange(-9.0, 9.1, 3.0))
TILT_STDS_RAD = np.radians([0.3, 1.0, 2.0, 4.0, 6.0])  # candidates for the error of single pictures
DRAWS = 40  # draws of pictures, which show how much the mount depends on single ones
LEAST_PICTURES = 8
MOST_ANGLE_STD_RAD, MOST_HEIGHT_STD_RATIO, MOST_ROLL_STD_RAD = (
    math.radians(1.5), 0.08, math.radians(1.5),
)  # fmt: skip
# 1 sigma of what the steps of the grids and the supposed height of leaves leave open.
PITCH_MODEL_RAD, ROLL_MODEL_RAD, HEIGHT_MODEL_M = math.radians(0.4), math.radians(0.6), 0.04


class RowMountFit(msgspec.Struct, frozen=True, kw_only=True):
    """Mount of a camera over the ground; 1 sigma of each. Positive pitch looks down.

    `roll_rad` is None where the pictures do not show it. `tilt_std_rad` is how much single
    pictures are tilted against the others.
    """

    pictures: int
    pitch_rad: float
    pitch_std_rad: float
    height_m: float
    height_std_m: float
    roll_rad: float | None
    roll_std_rad: float
    tilt_std_rad: float

    def complaints(self) -> tuple[str, ...]:
        """Say why the fit must not be used; empty where it may."""
        found = []
        if self.pictures < LEAST_PICTURES:
            found.append(
                f"{self.pictures} pictures, at least {LEAST_PICTURES} are needed; take more along "
                "rows"
            )
        if not max(self.pitch_std_rad, self.height_std_m) < math.inf:
            found.append(
                "no mount fits better than its neighbours; give pictures that show several rows "
                "run away from the camera"
            )
        elif self.pitch_std_rad > MOST_ANGLE_STD_RAD:
            found.append(
                f"pitch is known to {math.degrees(self.pitch_std_rad):.1f} degrees only, "
                f"{math.degrees(MOST_ANGLE_STD_RAD):.1f} are needed; give more pictures, and a "
                "camera that sees rows meet"
            )
        elif self.height_std_m > MOST_HEIGHT_STD_RATIO * self.height_m:
            found.append(
                f"the height is known to {100 * self.height_std_m:.0f} cm only, "
                f"{100 * MOST_HEIGHT_STD_RATIO * self.height_m:.0f} are needed; give more "
                "pictures that show three rows or more"
            )
        return tuple(found)


class _Axes(NamedTuple):
    pitches_rad: FloatArray
    spacings_m: FloatArray


def fit_row_mount(
    contrasts: Sequence[FloatArray], camera: CameraSpec, spacing_m: float, rng: np.random.Generator
) -> RowMountFit:
    """Fit the mount to contrasts (CELLS, CELLS) of pictures of rows `spacing_m` apart."""
    nearest, farthest = (
        (UNIT_M - FOLIAGE_M) * spacing_m / (height_m - FOLIAGE_M) for height_m in HEIGHTS_M[::-1]
    )
    coarse = _Axes(PITCHES_RAD, np.geomspace(nearest, farthest, SPACINGS))
    level = _open_view(camera, 0.0)
    table = np.stack([_weigh(one, coarse, level, YAWS_RAD) for one in contrasts])
    best = _find_coarse(table[None])
    found = _Axes(coarse.pitches_rad[best[0], None], coarse.spacings_m[best[1], None])
    near = _Axes(found.pitches_rad + NEAR_RAD, found.spacings_m * NEAR_RATIO)
    yaws_rad = [_find_yaw(one, found, level) + NEAR_YAWS_RAD for one in contrasts]
    pairs = list(zip(contrasts, yaws_rad, strict=True))
    views = [_open_view(camera, float(roll_rad)) for roll_rad in ROLLS_RAD]
    tables = np.stack([[_weigh(one, near, view, yaws) for one, yaws in pairs] for view in views])
    tilt_std_rad = max(TILT_STDS_RAD, key=lambda std: _find_most(_tilt(tables, NEAR_RAD, std)))
    tilted = _tilt(tables, NEAR_RAD, float(tilt_std_rad))
    mean, std = _summarise(tilted.sum(axis=1), near)
    draws = rng.integers(len(contrasts), size=(DRAWS, len(contrasts)))
    drawn = np.array([_summarise(tilted[:, k].sum(axis=1), near)[0] for k in draws])
    apart_m = float(mean[1])
    drawn[:, 1] /= apart_m
    std = np.maximum(std, drawn.std(axis=0))
    height_m = (UNIT_M - FOLIAGE_M) * spacing_m / apart_m
    roll_std_rad = math.hypot(float(std[2]), ROLL_MODEL_RAD)
    return RowMountFit(
        pictures=len(contrasts),
        pitch_rad=float(mean[0]),
        pitch_std_rad=math.hypot(float(std[0]), PITCH_MODEL_RAD),
        height_m=height_m + FOLIAGE_M,
        height_std_m=math.hypot(height_m * float(std[1]), HEIGHT_MODEL_M),
        roll_rad=float(mean[2]) if roll_std_rad <= MOST_ROLL_STD_RAD else None,
        roll_std_rad=roll_std_rad,
        tilt_std_rad=float(tilt_std_rad),
    )


def _weigh(contrast: FloatArray, axes: _Axes, view: FarView, yaws_rad: FloatArray) -> FloatArray:
    """Weigh mounts (pitches, spacings) by the log-likelihood of a picture, at any of the yaws.

    A mount that sees less ground explains less of the picture.
    """
    grid = RowGrid(axes.pitches_rad, yaws_rad, axes.spacings_m)
    score = view.compare_fine(contrast, grid).score.clip(0.0).astype(np.float64)
    cells = [len(view.find_ground(float(pitch_rad)).cell) for pitch_rad in axes.pitches_rad]
    plants = PLANTS * np.array(cells)[:, None, None] / CELLS**2
    return _mean_exp(0.5 * plants * score**2, axis=1)


def _find_yaw(contrast: FloatArray, mount: _Axes, view: FarView) -> float:
    """Find the direction of the rows in a picture of a camera mounted so."""
    grid = RowGrid(mount.pitches_rad, YAWS_RAD, mount.spacings_m)
    return float(YAWS_RAD[view.compare_fine(contrast, grid).score.argmax()])


def _open_view(camera: CameraSpec, roll_rad: float) -> FarView:
    """Open the view of a camera that looks at the horizon, UNIT_M high."""
    rolled = rotation_from_rpy(roll_rad, 0.0, 0.0) @ LINK_FROM_OPTICAL[:3, :3]
    rays = find_rays(camera, (CELLS, CELLS)) @ rolled.T
    return FarView(rays, np.array([0.0, 0.0, UNIT_M]), tilts_rad=np.zeros(0), is_mounted=False)


def _mean_exp(weighed: FloatArray, axis: int) -> FloatArray:
    """Average likelihoods along an axis of their logarithms."""
    most = weighed.max(axis=axis, keepdims=True)
    mean: FloatArray = np.log(np.exp(weighed - most).mean(axis=axis)) + most.squeeze(axis)
    return mean


def _find_coarse(tables: FloatArray) -> tuple[int, int]:
    """Find the likeliest pitch and spacing of weights (1, pictures, pitches, spacings)."""
    tilted = (_tilt(tables, PITCHES_RAD, float(std_rad)) for std_rad in TILT_STDS_RAD)
    total = max((one.sum(axis=(0, 1)) for one in tilted), key=np.max)
    pitch, spacing = np.unravel_index(int(total.argmax()), total.shape)
    return int(pitch), int(spacing)


def _tilt(tables: FloatArray, pitches_rad: FloatArray, std_rad: float) -> FloatArray:
    """Let each picture (rolls, pictures, pitches, spacings) be tilted by itself."""
    off = (pitches_rad[:, None] - pitches_rad) / std_rad
    share = np.exp(-0.5 * off**2)
    share /= share.sum(axis=1, keepdims=True)
    most = tables.max(axis=2, keepdims=True)
    tilted: FloatArray = np.log(share @ np.exp(tables - most) + 1e-30) + most
    return tilted


def _find_most(tilted: FloatArray) -> float:
    return float(tilted.sum(axis=1).max())


def _summarise(total: FloatArray, axes: _Axes) -> tuple[FloatArray, FloatArray]:
    """Find pitch, spacing and roll at the peak of weights (rolls, pitches, spacings), and sigmas.

    The sigma of a spacing is relative.
    """
    peaks = (
        _find_peak(axes.pitches_rad, total.max(axis=(0, 2))),
        _find_peak(np.log(axes.spacings_m), total.max(axis=(0, 1))),
        _find_peak(ROLLS_RAD, total.max(axis=(1, 2))),
    )
    (pitch_rad, spacing, roll_rad), stds = np.array(peaks).T
    return np.array([pitch_rad, math.exp(spacing), roll_rad]), stds


def _find_peak(axis: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """Find the peak of log-likelihoods by the parabola through its highest three, and its sigma.

    The sigma is infinite where the peak lies at an end of the axis.
    """
    k, step = int(weight.argmax()), float(axis[1] - axis[0])
    if not 0 < k < len(axis) - 1:
        return float(axis[k]), math.inf
    before, here, after = (float(value) for value in weight[k - 1 : k + 2])
    curvature = 2.0 * here - before - after
    if curvature <= 0.0:
        return float(axis[k]), math.inf
    return float(axis[k]) + step * (after - before) / (2.0 * curvature), step / math.sqrt(curvature)
