"""The view of a camera, and lens distortion as a look-up in a wider pinhole picture."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from agribot.core.errors import DescriptionError
from agribot.core.geo import inverse
from agribot.core.lens import distort, undistort
from agribot.core.messages import FloatArray
from agribot.core.robot import CameraSpec
from agribot.sim.camera.arrays import PinholeView, Singles, Targets
from agribot.sim.jit import compile_fast

TOLERANCE_PX = 0.01
MAX_WIDENING = 3.0  # largest size of the pinhole picture against the distorted one


class Lens(NamedTuple):
    """Place of each drawn pixel of the distorted picture in the pinhole picture.

    `source` (height, width, 2) holds columns and rows; the pinhole picture is wider by `pad_x_px`
    on the left and right and by `pad_y_px` above and below.
    """

    source: Singles
    pad_x_px: int
    pad_y_px: int


def make_view(
    map_from_camera: FloatArray, camera: CameraSpec, fine: int, lens: Lens | None
) -> PinholeView:
    """Make the pinhole to draw from `map_from_camera` (4, 4), with `fine` pixels per pixel side."""
    pad_x, pad_y = (lens.pad_x_px, lens.pad_y_px) if lens else (0, 0)
    width, height = camera.width_px * fine + 2 * pad_x, camera.height_px * fine + 2 * pad_y
    return PinholeView(
        eye=np.array(map_from_camera[:3, 3], dtype=float),
        camera_from_map=np.ascontiguousarray(inverse(map_from_camera)[:3, :3]),
        focal_px=camera.focal_px * fine, cx_px=(width - 1) / 2.0, cy_px=(height - 1) / 2.0,
        near_m=camera.clip_near_m, far_m=camera.clip_far_m, width=width, height=height,
    )  # fmt: skip


@lru_cache(maxsize=4)
def make_lens(camera: CameraSpec, fine: int) -> Lens | None:
    """Make the look-up of a camera's distortion; None where it has none.

    There are `fine` drawn pixels along a side of a pixel.

    Raises: DescriptionError: coefficients that fold the picture over itself or need a much
        wider pinhole.
    """
    if not any(camera.distortion):
        return None
    width, height, focal_px = (
        camera.width_px * fine,
        camera.height_px * fine,
        camera.focal_px * fine,
    )
    row, column = np.mgrid[0:height, 0:width]
    seen = np.stack([column - (width - 1) / 2.0, row - (height - 1) / 2.0], axis=-1) / focal_px
    ideal = undistort(seen, camera.distortion)
    error_px = np.abs(distort(ideal, camera.distortion) - seen).max() * camera.focal_px
    reach = np.abs(ideal).reshape(-1, 2).max(axis=0) * focal_px
    widening = float((reach / (np.array([width, height]) / 2.0)).max())
    if not (error_px < TOLERANCE_PX and widening < MAX_WIDENING):
        raise DescriptionError(
            f"the lens distortion {camera.distortion} cannot be undone over the whole picture: "
            f"{error_px:.3g} px are left (limit {TOLERANCE_PX}), the pinhole picture would be "
            f"{widening:.3g} times as wide (limit {MAX_WIDENING}); use smaller coefficients"
        )
    pads = [math.ceil(max(0.0, r - (size - 1) / 2.0)) + 1
            for r, size in zip(reach.tolist(), (width, height), strict=True)]  # fmt: skip
    middle = np.array([(width - 1) / 2.0 + pads[0], (height - 1) / 2.0 + pads[1]])
    return Lens((ideal * focal_px + middle).astype(np.float32), *pads)


@compile_fast
def bend_rows(first: int, last: int, source: Singles, drawn: Targets, bent: Targets) -> None:
    """Fill the rows [first, last) of `bent` by `source` (height, width, 2) from `drawn`.

    Colours are interpolated between pixels, the rest is from the nearest.
    """
    colour, inverse_depth = drawn.colour, drawn.inverse_depth
    label, instance = drawn.label, drawn.instance
    out_colour, out_inverse_depth = bent.colour, bent.inverse_depth
    out_label, out_instance = bent.label, bent.instance
    for row in range(first, last):
        for column in range(source.shape[1]):
            u, v = float(source[row, column, 0]), float(source[row, column, 1])
            c = min(max(int(u), 0), colour.shape[1] - 2)
            r = min(max(int(v), 0), colour.shape[0] - 2)
            right, below = u - c, v - r
            for k in range(3):
                top = colour[r, c, k] * (1.0 - right) + colour[r, c + 1, k] * right
                bottom = colour[r + 1, c, k] * (1.0 - right) + colour[r + 1, c + 1, k] * right
                out_colour[row, column, k] = top * (1.0 - below) + bottom * below
            if right >= 0.5:
                c += 1
            if below >= 0.5:
                r += 1
            out_inverse_depth[row, column] = inverse_depth[r, c]
            out_label[row, column] = label[r, c]
            out_instance[row, column] = instance[r, c]
