"""Shadows on the ground, computed once into blocks of a fine grid.

Only blocks that something shades exist, so that a large and mostly empty world stays small.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agribot.sim.camera.arrays import Bytes, Doubles, Forms, Instances, Ints
from agribot.sim.jit import compile_fast

BLOCK_BITS = 7
BLOCK = 1 << BLOCK_BITS  # texels along a side of a block
MAX_BLOCKS = 4096  # 64 MiB
LOWEST_SUN = 0.2  # sine of the elevation: longer shadows are cut to this
SHADOW_LOD = 1
LIT = 255
CLEAR_DIFFUSE = 0.5  # direct light from which on shadows are as sharp as they get
# Further passes of the 3 x 3 mean where no light is direct: a blur of about 3 cm.
OVERCAST_PASSES = 12
OVERCAST_MARGIN_M = 0.1


class ShadowMap(NamedTuple):
    """Shadows in blocks.

    `shade` (blocks, 128, 128): 255 is lit; `block` (rows, columns): index or -1 for all lit.
    """

    shade: Bytes
    block: Ints
    x_m: float
    y_m: float
    step_m: float


def bake_shadows(
    forms: Forms,
    obstacles: Instances,
    plants: Instances,
    base_m: tuple[Doubles, Doubles],
    to_sun: Doubles,
    step_m: float,
    direct: float = 1.0,
) -> ShadowMap:
    """Draw the shadows of obstacles and plants that stand on ground of heights `base_m` (n,).

    Plants in the shade of an obstacle get that noted in `plants.sun`. A step too fine for the
    memory is doubled until it fits. The less of the light is `direct`, the softer they are.
    """
    slope = compute_shadow_slope(to_sun, direct)
    groups = [
        (things, base, _find_boxes(forms, things, base, slope))
        for things, base in zip((obstacles, plants), base_m, strict=True)
        if len(things.form)
    ]
    if not groups:
        return ShadowMap(
            np.empty((0, BLOCK, BLOCK), np.uint8), np.empty((0, 0), np.int32), 0.0, 0.0, step_m
        )
    boxes = np.concatenate([box for _things, _base, box in groups])
    boxes += (1.0 - direct) * OVERCAST_MARGIN_M * np.array([-1.0, 1.0, -1.0, 1.0])
    x_m, y_m = float(boxes[:, 0].min()), float(boxes[:, 2].min())
    block = _make_block_index(boxes, x_m, y_m, step_m)
    while block.max() >= MAX_BLOCKS:
        step_m *= 2.0
        block = _make_block_index(boxes, x_m, y_m, step_m)
    shade = np.full((int(block.max()) + 1, BLOCK, BLOCK), LIT, np.uint8)
    for things, base, _box in groups:
        if things is plants:
            _note_shade(plants, shade, block, x_m, y_m, step_m)
        _bake(forms, things, base, slope, shade, block, x_m, y_m, step_m)
    for _ in range(1 + round((1.0 - direct) * OVERCAST_PASSES)):
        shade = _soften(shade, block)
    return ShadowMap(shade, block, x_m, y_m, step_m)


def compute_directness(diffuse: float) -> float:
    """Return 1 under a clear sky, 0 where all light comes from the clouds."""
    return min(1.0, diffuse / CLEAR_DIFFUSE)


def compute_shadow_slope(to_sun: Doubles, direct: float = 1.0) -> Doubles:
    """Return how far a shadow moves, east and north (2,), for a metre of height.

    The less of the light is `direct`, the nearer to the foot of a thing its shadow stays.
    """
    slope: Doubles = -direct * to_sun[:2] / max(float(to_sun[2]), LOWEST_SUN)
    return slope


@compile_fast
def _find_boxes(forms: Forms, things: Instances, base_m: Doubles, slope: Doubles) -> Doubles:
    """Return smallest and largest x and y of each thing's shadow, (n, 4), map."""
    boxes = np.empty((things.form.shape[0], 4))
    for i in range(things.form.shape[0]):
        mesh = things.form[i] + SHADOW_LOD * forms.forms
        boxes[i, 0], boxes[i, 1], boxes[i, 2], boxes[i, 3] = 1e9, -1e9, 1e9, -1e9
        for j in range(forms.vertices[mesh]):
            x, y = _project_shadow(forms, things, i, forms.first_vertex[mesh] + j, base_m[i], slope)
            boxes[i, 0], boxes[i, 1] = min(boxes[i, 0], x), max(boxes[i, 1], x)
            boxes[i, 2], boxes[i, 3] = min(boxes[i, 2], y), max(boxes[i, 3], y)
    return boxes


@compile_fast
def _project_shadow(
    forms: Forms, things: Instances, i: int, vertex: int, base_m: float, slope: Doubles
) -> tuple[float, float]:
    """Return where the shadow of a vertex falls on level ground, metres in the map."""
    turn, scale, p = things.rotation[i], things.scale[i], forms.vertex[vertex]
    x = (turn[0, 0] * p[0] + turn[0, 1] * p[1] + turn[0, 2] * p[2]) * scale
    y = (turn[1, 0] * p[0] + turn[1, 1] * p[1] + turn[1, 2] * p[2]) * scale
    z = (turn[2, 0] * p[0] + turn[2, 1] * p[1] + turn[2, 2] * p[2]) * scale
    height = max(0.0, z + things.position[i, 2] - base_m)
    return (
        x + things.position[i, 0] + slope[0] * height,
        y + things.position[i, 1] + slope[1] * height,
    )


def _make_block_index(boxes: Doubles, x_m: float, y_m: float, step_m: float) -> Ints:
    """Return the index of each block (rows, columns) that some box touches, -1 for the others."""
    size_m = BLOCK * step_m
    columns = int((boxes[:, 1].max() - x_m) / size_m) + 1
    rows = int((boxes[:, 3].max() - y_m) / size_m) + 1
    block = np.full((rows, columns), -1, np.int32)
    _number_blocks(boxes, x_m, y_m, size_m, block)
    return block


@compile_fast
def _number_blocks(boxes: Doubles, x_m: float, y_m: float, size: float, block: Ints) -> None:
    count = 0
    for i in range(boxes.shape[0]):
        for row in range(int((boxes[i, 2] - y_m) / size), int((boxes[i, 3] - y_m) / size) + 1):
            for column in range(
                int((boxes[i, 0] - x_m) / size), int((boxes[i, 1] - x_m) / size) + 1
            ):
                if block[row, column] < 0:
                    block[row, column] = count
                    count += 1


@compile_fast
def _note_shade(
    plants: Instances, shade: Bytes, block: Ints, x_m: float, y_m: float, step_m: float
) -> None:
    for i in range(plants.form.shape[0]):
        column = int((plants.position[i, 0] - x_m) / step_m)
        row = int((plants.position[i, 1] - y_m) / step_m)
        plants.sun[i] = _read_texel(shade, block, row, column) / LIT


@compile_fast
def _read_texel(shade: Bytes, block: Ints, row: int, column: int) -> float:
    r, c = row // BLOCK, column // BLOCK
    if r < 0 or c < 0 or r >= block.shape[0] or c >= block.shape[1] or block[r, c] < 0:
        return float(LIT)
    return float(shade[block[r, c], row % BLOCK, column % BLOCK])


@compile_fast
def _bake(
    forms: Forms, things: Instances, base_m: Doubles, slope: Doubles, shade: Bytes, block: Ints,
    x_m: float, y_m: float, step_m: float,
) -> None:  # fmt: skip
    x, y = np.empty(3), np.empty(3)
    for i in range(things.form.shape[0]):
        mesh = things.form[i] + SHADOW_LOD * forms.forms
        for t in range(forms.first_face[mesh], forms.first_face[mesh] + forms.faces[mesh]):
            for k in range(3):
                vertex = forms.first_vertex[mesh] + forms.face[t, k]
                east, north = _project_shadow(forms, things, i, vertex, base_m[i], slope)
                x[k], y[k] = (east - x_m) / step_m - 0.5, (north - y_m) / step_m - 0.5
            _darken(x, y, shade, block)


@compile_fast
def _darken(x: Doubles, y: Doubles, shade: Bytes, block: Ints) -> None:
    """Darken the texels whose centre is in a triangle of texel coordinates."""
    area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
    if area == 0.0:
        return
    last_row = min(math.floor(max(y[0], y[1], y[2])), block.shape[0] * BLOCK - 1)
    last_column = min(math.floor(max(x[0], x[1], x[2])), block.shape[1] * BLOCK - 1)
    for row in range(max(0, math.ceil(min(y[0], y[1], y[2]))), last_row + 1):
        for column in range(max(0, math.ceil(min(x[0], x[1], x[2]))), last_column + 1):
            a = ((x[1] - column) * (y[2] - row) - (x[2] - column) * (y[1] - row)) / area
            b = ((x[2] - column) * (y[0] - row) - (x[0] - column) * (y[2] - row)) / area
            if a >= 0.0 and b >= 0.0 and a + b <= 1.0:
                here = block[row // BLOCK, column // BLOCK]
                if here >= 0:
                    shade[here, row % BLOCK, column % BLOCK] = 0


@compile_fast
def _soften(shade: Bytes, block: Ints) -> Bytes:
    """Return the mean of 3 x 3 texels: the edge of a shadow is never sharp."""
    soft = np.empty_like(shade)
    for r in range(block.shape[0]):
        for c in range(block.shape[1]):
            here = block[r, c]
            if here < 0:
                continue
            for row in range(BLOCK):
                for column in range(BLOCK):
                    total = 0.0
                    inside = 0 < row < BLOCK - 1 and 0 < column < BLOCK - 1
                    for down in range(row - 1, row + 2):
                        for right in range(column - 1, column + 2):
                            if inside:
                                total += shade[here, down, right]
                            else:
                                total += _read_texel(
                                    shade, block, r * BLOCK + down, c * BLOCK + right
                                )
                    soft[here, row, column] = np.uint8(total / 9.0 + 0.5)
    return soft
