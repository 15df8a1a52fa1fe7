"""The flat arrays that the compiled loops of the renderer read and write."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Singles = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Floats = npt.NDArray[np.floating[Any]]  # single or double precision
Longs = npt.NDArray[np.int64]
Ints = npt.NDArray[np.int32]
Bytes = npt.NDArray[np.uint8]


class Forms(NamedTuple):
    """All meshes end to end; mesh `lod * forms + form` is a form at a level of detail.

    `vertex` is (V, 9): position, unit normal, u, v, tone.
    """

    vertex: Singles
    face: Ints
    first_vertex: Longs
    vertices: Longs
    first_face: Longs
    faces: Longs
    radius: Singles
    forms: int


class Instances(NamedTuple):
    """Things that stand in the world, each a scaled and turned form.

    `sun` is how much of the sun reaches the thing past the obstacles, `layer` its texture,
    `id` the index of its plant or -1, `solid` 1 where no light shines through.
    """

    position: Doubles
    rotation: Singles
    scale: Singles
    form: Longs
    tint: Singles
    sun: Singles
    layer: Longs
    label: Bytes
    id: Ints
    solid: Bytes


class PinholeView(NamedTuple):
    """A pinhole at `eye` (map, metres); rows of `camera_from_map` are right, down, forward."""

    eye: Doubles
    camera_from_map: Doubles
    focal_px: float
    cx_px: float
    cy_px: float
    near_m: float
    far_m: float
    width: int
    height: int


class Lamp(NamedTuple):
    """The sun and the sky. `to_sun` is a unit vector in the map."""

    to_sun: Doubles
    diffuse: float
    ambient: float
    haze_per_m: float


class TexturePyramid(NamedTuple):
    """Textures with their smaller copies: `texel` is (layers, texels of all levels, 3)."""

    texel: Singles
    first: Longs
    width: Longs
    height: Longs


class Targets(NamedTuple):
    """The picture while it is drawn, (height, width, ...); `place` holds terrain's map x and y."""

    colour: Singles
    inverse_depth: Singles
    label: Bytes
    instance: Ints
    place: Doubles


class RobotShade(NamedTuple):
    """Light past the robot on the level `level_m` (map z): `shade` (rows, columns), 255 is lit.

    A point in the shade of a texel is dark up to the height `top` over the level. `slope` (2,)
    is how far, east and north, a shadow moves for a metre of height.
    """

    shade: Bytes
    top: Singles
    level_m: float
    x_m: float
    y_m: float
    step_m: float
    slope: Doubles


class Ground(NamedTuple):
    """Flat ground or terrain, what covers it and where the sun does not reach.

    `surface` (rows, columns) is the texture layer between the edges `x_edge` and `y_edge`.
    `height` is (0, 0) for flat ground. `shade` holds blocks of shadow; `block` (rows, columns) is
    the index of a block, or -1 where all of it is lit.
    """

    x_edge: Doubles
    y_edge: Doubles
    surface: Bytes
    repeat_per_m: float
    tone: Singles
    tone_per_m: float
    height: Singles
    height_x_m: float
    height_y_m: float
    height_step_m: float
    shade: Bytes
    block: Ints
    shade_x_m: float
    shade_y_m: float
    shade_step_m: float


def _halve(images: Singles) -> Singles:
    """Average squares of 2 x 2 px; a mean over these two axes takes five times as long."""
    halved = images[:, 0::2, 0::2] + images[:, 0::2, 1::2]
    halved += images[:, 1::2, 0::2]
    halved += images[:, 1::2, 1::2]
    halved *= np.float32(0.25)
    return halved


def build_pyramid(images: Singles, levels: int, contrast: float = 1.0) -> TexturePyramid:
    """Pack images (layers, height, width, 3) with up to `levels` halvings.

    Each copy keeps `contrast` of the deviations of the one before.
    """
    texels, first, widths, heights = [], [], [], []
    start, level = 0, images
    for _ in range(levels):
        layers, height, width, _rgb = level.shape
        texels.append(level.reshape(layers, -1, 3))
        first.append(start)
        widths.append(width)
        heights.append(height)
        start += width * height
        if min(width, height) < 2:
            break
        level = _halve(level)
        mean = level.mean(axis=(1, 2), keepdims=True)
        level = mean + (level - mean) * np.float32(contrast)
    return TexturePyramid(
        np.ascontiguousarray(np.concatenate(texels, axis=1), dtype=np.float32),
        np.array(first), np.array(widths), np.array(heights),
    )  # fmt: skip
