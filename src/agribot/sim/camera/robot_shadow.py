"""The robot's shadow: a small map of the ground around it, new for each frame.

Map points slide along the sun's rays to the level of the robot's body frame. There, each texel
keeps the height over that level below which points are in the shade.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage

from agribot.sim.camera.arrays import Bytes, Doubles, Forms, Instances, RobotShade, Singles
from agribot.sim.jit import compile_fast

STEP_M = 0.01
MAX_TEXELS = 600  # texels along a side; the step grows when the shadow is longer
MARGIN = 3
LIT = 255
OVERCAST_BLUR_M = 0.06  # deviation of the blur where no light is direct
NOTHING = -10.0  # metres: lower than any part of the robot


def make_empty_shade() -> RobotShade:
    return RobotShade(np.empty((0, 0), np.uint8), np.empty((0, 0), np.float32),
                      0.0, 0.0, 0.0, 1.0, np.zeros(2))  # fmt: skip


def cast_robot_shade(
    forms: Forms, things: Instances, first: int, level_m: float, slope: Doubles,
    direct: float = 1.0,
) -> RobotShade:  # fmt: skip
    """Cast the shadow of the things from index `first` on, on the level `level_m` (map z).

    `slope` (2,) is how far, east and north, a shadow moves for a metre of height. The less of
    the light is `direct`, the softer the edges.
    """
    faces = int(forms.faces[things.form[first:]].sum())
    corner = np.empty((faces, 3, 3))
    box = _cast(forms, things, first, level_m, slope, corner)
    extent_m = max(box[1] - box[0], box[3] - box[2])
    step_m = max(STEP_M, extent_m / (MAX_TEXELS - 2 * MARGIN - 1))
    margin = MARGIN + math.ceil(3.0 * (1.0 - direct) * OVERCAST_BLUR_M / step_m)
    x_m, y_m = box[0] - margin * step_m, box[2] - margin * step_m
    columns = int((box[1] - x_m) / step_m) + margin + 1
    rows = int((box[3] - y_m) / step_m) + margin + 1
    top = np.full((rows, columns), NOTHING, np.float32)
    _cover(corner, x_m, y_m, step_m, top)
    shade, soft_top = np.empty((rows, columns), np.uint8), np.empty((rows, columns), np.float32)
    _soften(top, shade, soft_top)
    if direct < 1.0:
        blur = (1.0 - direct) * OVERCAST_BLUR_M / step_m
        shade = ndimage.gaussian_filter(shade, blur, mode="nearest")
        soft_top = ndimage.maximum_filter(soft_top, 2 * (margin - MARGIN) + 1)
    return RobotShade(shade, soft_top, level_m, x_m, y_m, step_m, slope)


@compile_fast
def _cast(
    forms: Forms, things: Instances, first: int, level_m: float, slope: Doubles, corner: Doubles
) -> tuple[float, float, float, float]:
    """Write the corners of all shadows, (n, 3, 3): x, y, height over the level; return bounds."""
    x_min, x_max, y_min, y_max = 1e9, -1e9, 1e9, -1e9
    vertex, face, n = forms.vertex, forms.face, 0
    for i in range(first, things.form.shape[0]):
        turn, at, origin = (
            things.rotation[i],
            things.position[i],
            forms.first_vertex[things.form[i]],
        )
        start = forms.first_face[things.form[i]]
        for t in range(start, start + forms.faces[things.form[i]]):
            for k in range(3):
                p = vertex[origin + face[t, k]]
                height = turn[2, 0] * p[0] + turn[2, 1] * p[1] + turn[2, 2] * p[2]
                height += at[2] - level_m
                x = turn[0, 0] * p[0] + turn[0, 1] * p[1] + turn[0, 2] * p[2]
                y = turn[1, 0] * p[0] + turn[1, 1] * p[1] + turn[1, 2] * p[2]
                x += at[0] + slope[0] * height
                y += at[1] + slope[1] * height
                corner[n, k, 0], corner[n, k, 1], corner[n, k, 2] = x, y, height
                x_min, x_max = min(x_min, x), max(x_max, x)
                y_min, y_max = min(y_min, y), max(y_max, y)
            n += 1
    return x_min, x_max, y_min, y_max


@compile_fast
def _cover(corner: Doubles, x_m: float, y_m: float, step_m: float, top: Singles) -> None:
    """Raise the texels whose centre is in a triangle to its height there."""
    for n in range(corner.shape[0]):
        xa, ya = (corner[n, 0, 0] - x_m) / step_m, (corner[n, 0, 1] - y_m) / step_m
        xb, yb = (corner[n, 1, 0] - x_m) / step_m, (corner[n, 1, 1] - y_m) / step_m
        xc, yc = (corner[n, 2, 0] - x_m) / step_m, (corner[n, 2, 1] - y_m) / step_m
        area = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)
        if area == 0.0:
            continue
        for row in range(math.ceil(min(ya, yb, yc)), math.floor(max(ya, yb, yc)) + 1):
            for column in range(math.ceil(min(xa, xb, xc)), math.floor(max(xa, xb, xc)) + 1):
                a = ((xb - column) * (yc - row) - (xc - column) * (yb - row)) / area
                b = ((xc - column) * (ya - row) - (xa - column) * (yc - row)) / area
                if a >= 0.0 and b >= 0.0 and a + b <= 1.0:
                    height = a * corner[n, 0, 2] + b * corner[n, 1, 2]
                    height += (1.0 - a - b) * corner[n, 2, 2]
                    top[row, column] = max(top[row, column], height)


@compile_fast
def _soften(top: Singles, shade: Bytes, soft_top: Singles) -> None:
    """Write the mean light of 3 x 3 texels, and the highest of their tops."""
    rows, columns = top.shape
    for row in range(rows):
        for column in range(columns):
            dark, highest = 0, NOTHING
            for r in range(max(0, row - 1), min(rows, row + 2)):
                for c in range(max(0, column - 1), min(columns, column + 2)):
                    if top[r, c] > NOTHING:
                        dark += 1
                        highest = max(highest, top[r, c])
            shade[row, column] = np.uint8(LIT - dark * LIT / 9.0 + 0.5)
            soft_top[row, column] = highest


@compile_fast
def shade_points(
    count: int, x: Doubles, y: Doubles, z: Doubles, rover: RobotShade, past: Singles
) -> None:
    """Write the share of the sun that reaches map points past the robot into `past`.

    `x`, `y`, `z` and `past` are (count,).
    """
    dark, top, level_m = rover.shade, rover.top, rover.level_m
    rows, columns, per_step = dark.shape[0], dark.shape[1], 1.0 / rover.step_m
    slope_x, slope_y = rover.slope[0], rover.slope[1]
    x_m, y_m = rover.x_m, rover.y_m
    for k in range(count):
        rise = z[k] - level_m
        column = int((x[k] + slope_x * rise - x_m) * per_step + 0.5)
        row = int((y[k] + slope_y * rise - y_m) * per_step + 0.5)
        past[k] = 1.0
        if 0 <= row < rows and 0 <= column < columns and rise <= top[row, column]:
            past[k] = dark[row, column] * (1.0 / LIT)
