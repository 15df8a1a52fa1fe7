"""The ground in a picture, one row at a time: where it is, how it is lit, what covers it."""

from __future__ import annotations

import math

import numpy as np

from agribot.sim.camera.arrays import (
    Doubles,
    Ground,
    Ints,
    Lamp,
    PinholeView,
    Singles,
    Targets,
    TexturePyramid,
)
from agribot.sim.camera.shadows import BLOCK, BLOCK_BITS
from agribot.sim.jit import compile_fast, inline_fast

TERRAIN = -2  # value of `Targets.instance` where terrain was drawn
TONE_SIZE = 256  # side of the square of slow changes of brightness
SHARPNESS = 1.5  # texels to a pixel above which a smaller copy of a texture is used
# Neighbouring pixels change to the smaller copy at slightly different distances, which hides
# the seam: factors 2^(-1/2 .. 1/2) in the order of a 4 x 4 Bayer matrix.
_BAYER = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]])
SEAM = SHARPNESS * 2.0 ** ((_BAYER + 0.5) / 16.0 - 0.5)


@compile_fast
def find_ground(
    row: int, view: PinholeView, ground: Ground, targets: Targets, place: Doubles, layer: Ints
) -> None:
    """Find map x, y and surface of the ground pixels of a row; layer -1 where something else is.

    Writes into `place` (2, width) and `layer` (width,), and completes the depth of flat ground
    where nothing was drawn before it.
    """
    turn, eye_x, eye_y, eye_z = view.camera_from_map, view.eye[0], view.eye[1], view.eye[2]
    inverse_depth, instance, drawn = targets.inverse_depth, targets.instance, targets.place
    x_edge, y_edge, surface = ground.x_edge, ground.y_edge, ground.surface
    flat = ground.height.shape[0] == 0
    down = (row - view.cy_px) / view.focal_px
    east_step, north_step, up_step = turn[0, 0], turn[0, 1], turn[0, 2]
    east_0 = turn[1, 0] * down + turn[2, 0]
    north_0 = turn[1, 1] * down + turn[2, 1]
    up_0 = turn[1, 2] * down + turn[2, 2]
    tile_x, tile_y = 0, 0
    for column in range(view.width):
        right = (column - view.cx_px) / view.focal_px
        layer[column] = -1
        if flat:
            up = up_0 + up_step * right
            if inverse_depth[row, column] > 0.0 or eye_z <= 0.0 or up * view.far_m > -eye_z:
                continue
            depth = -eye_z / up
            inverse_depth[row, column] = 1.0 / depth
            x = eye_x + (east_0 + east_step * right) * depth
            y = eye_y + (north_0 + north_step * right) * depth
        else:
            if instance[row, column] != TERRAIN:
                continue
            instance[row, column] = -1
            x, y = drawn[row, column, 0], drawn[row, column, 1]
        place[0, column], place[1, column] = x, y
        if not x_edge[tile_x] <= x < x_edge[tile_x + 1]:
            tile_x = find_cell(x_edge, x)
        if not y_edge[tile_y] <= y < y_edge[tile_y + 1]:
            tile_y = find_cell(y_edge, y)
        layer[column] = surface[tile_y, tile_x]


@compile_fast
def find_cell(edge: Doubles, at: float) -> int:
    cell: int = min(max(np.searchsorted(edge, at, side="right") - 1, 0), edge.shape[0] - 2)
    return cell


@compile_fast
def light_ground(
    row: int, view: PinholeView, lamp: Lamp, ground: Ground, past: Singles, inverse_depth: Singles,
    place: Doubles, layer: Ints, light: Singles, texels_per_px: Singles, texels_per_m: float,
) -> None:  # fmt: skip
    """Light the ground pixels of a row, and find how many texels each of them covers.

    Writes into `light` and `texels_per_px`; `past` is the share of the sun that reaches each
    pixel past the robot. All are (width,).
    """
    shade, block, tone, height = ground.shade, ground.block, ground.tone, ground.height
    sun_x, sun_y, sun_z = lamp.to_sun[0], lamp.to_sun[1], lamp.to_sun[2]
    eye_x, eye_y, eye_z = view.eye[0], view.eye[1], view.eye[2]
    columns, rows = block.shape[1] * BLOCK, block.shape[0] * BLOCK
    # Arrays are taken out of their tuples once: a call that passes a tuple counts its references.
    height_x_m, height_y_m, height_step_m = (
        ground.height_x_m, ground.height_y_m, ground.height_step_m,
    )  # fmt: skip
    per_step = 1.0 / ground.shade_step_m
    for column in range(view.width):
        if layer[column] < 0:
            continue
        x, y = place[0, column], place[1, column]
        near = inverse_depth[row, column]
        to_x, to_y, to_z = eye_x - x, eye_y - y, eye_z
        facing, steep = sun_z, to_z
        if height.shape[0] > 0:
            reach_m = max(0.15, 0.01 / near)
            z, slope_x, slope_y = _measure_slope(
                height, height_x_m, height_y_m, 1.0 / height_step_m, x, y, reach_m
            )
            to_z -= z
            level = 1.0 / math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
            facing = max(0.0, sun_z - slope_x * sun_x - slope_y * sun_y) * level
            steep = (to_z - slope_x * to_x - slope_y * to_y) * level
        steep /= math.sqrt(to_x * to_x + to_y * to_y + to_z * to_z)
        sun = 1.0
        c, r = int((x - ground.shade_x_m) * per_step), int((y - ground.shade_y_m) * per_step)
        if 0 < c < columns and 0 < r < rows:
            here = block[r >> BLOCK_BITS, c >> BLOCK_BITS]
            if here >= 0:
                sun = shade[here, r & (BLOCK - 1), c & (BLOCK - 1)] * (1.0 / 255.0)
        sun = min(sun, past[column])
        # Slow changes of tone hide that the texture repeats.
        tone_x, tone_y = int(x * ground.tone_per_m), int(y * ground.tone_per_m)
        bright = tone[tone_y & (TONE_SIZE - 1), tone_x & (TONE_SIZE - 1)]
        ambient = lamp.ambient * (0.75 + 0.25 * sun)
        light[column] = (ambient + lamp.diffuse * facing * sun) * bright
        texels_per_px[column] = texels_per_m / (view.focal_px * near * max(0.25, steep))


@compile_fast
def lift_ground(ground: Ground, place: Doubles, layer: Ints, z: Doubles) -> None:
    """Write the map z of the ground pixels of a row into `z` (width,)."""
    height = ground.height
    for column in range(layer.shape[0]):
        z[column] = 0.0
        if height.shape[0] > 0 and layer[column] >= 0:
            z[column] = sample_height(
                height, ground.height_x_m, ground.height_y_m, ground.height_step_m,
                place[0, column], place[1, column],
            )  # fmt: skip


@inline_fast
def _measure_slope(
    height: Singles, x_min_m: float, y_min_m: float, per_m: float, x: float, y: float,
    reach_m: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Return a terrain's height and its slopes along x and y; `per_m` is samples per metre."""
    column, row, reach = (x - x_min_m) * per_m, (y - y_min_m) * per_m, reach_m * per_m
    east = _interpolate(height, column + reach, row)
    west = _interpolate(height, column - reach, row)
    north = _interpolate(height, column, row + reach)
    south = _interpolate(height, column, row - reach)
    mean = 0.25 * (east + west + north + south)
    return mean, (east - west) / (2 * reach_m), (north - south) / (2 * reach_m)


@compile_fast
def sample_height(
    height: Singles, x_min_m: float, y_min_m: float, step_m: float, x: float, y: float
) -> float:
    """Interpolate the height of a terrain (rows, columns); outside it is level."""
    return _interpolate(height, (x - x_min_m) / step_m, (y - y_min_m) / step_m)


@inline_fast
def _interpolate(height: Singles, column: float, row: float) -> float:
    """Interpolate a grid between its samples."""
    rows, columns = height.shape
    column = min(max(column, 0.0), columns - 1.001)
    row = min(max(row, 0.0), rows - 1.001)
    c, r = int(column), int(row)
    u, v = column - c, row - r
    # Indices without a sign need no check for counting from the end.
    at, up = (np.uintp(c), np.uintp(r)), (np.uintp(c + 1), np.uintp(r + 1))
    low = height[at[1], at[0]] * (1.0 - u) + height[at[1], up[0]] * u
    high = height[up[1], at[0]] * (1.0 - u) + height[up[1], up[0]] * u
    return float(low * (1.0 - v) + high * v)


@compile_fast
def paint_ground(
    row: int, textures: TexturePyramid, repeat_per_m: float, place: Doubles, layer: Ints,
    light: Singles, texels_per_px: Singles, colour: Singles,
) -> None:  # fmt: skip
    """Paint the ground pixels of a row into `colour` (height, width, 3), textured and lit."""
    texel, first = textures.texel, textures.first
    columns, rows = textures.width, textures.height
    for column in range(layer.shape[0]):
        k = layer[column]
        if k < 0:
            continue
        covered, seam, level = texels_per_px[column], SEAM[row & 3, column & 3], 0
        while covered > seam and level < first.shape[0] - 1:
            covered *= 0.5
            level += 1
        u, v = place[0, column] * repeat_per_m, place[1, column] * repeat_per_m
        u, v = (u - math.floor(u)) * columns[level], (v - math.floor(v)) * rows[level]
        c, r = int(u), int(v)
        right, below = u - c, v - r
        last_c, last_r = columns[level] - 1, rows[level] - 1  # sizes are powers of two
        top = first[level] + (r & last_r) * columns[level]
        bottom = first[level] + ((r + 1) & last_r) * columns[level]
        p, q = top + (c & last_c), top + ((c + 1) & last_c)
        s, t = bottom + (c & last_c), bottom + ((c + 1) & last_c)
        bright = light[column]
        a, b = (1.0 - right) * (1.0 - below) * bright, right * (1.0 - below) * bright
        d, e = (1.0 - right) * below * bright, right * below * bright
        for rgb in range(3):
            colour[row, column, rgb] = (
                texel[k, p, rgb] * a + texel[k, q, rgb] * b
                + texel[k, s, rgb] * d + texel[k, t, rgb] * e
            )  # fmt: skip
