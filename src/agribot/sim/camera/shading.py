"""Shading of ground, sky and haze behind the plants; then the sensor that takes the picture."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.sim.camera.arrays import (
    Bytes,
    Doubles,
    Ground,
    Ints,
    Lamp,
    PinholeView,
    RobotShade,
    Singles,
    Targets,
    TexturePyramid,
)
from agribot.sim.camera.ground import find_ground, lift_ground, light_ground, paint_ground
from agribot.sim.camera.robot_shadow import shade_points
from agribot.sim.jit import compile_fast, inline_fast

Counters = npt.NDArray[np.uint64]
CURVE_STEPS = 4  # entries of the tone curve for each grey level


class ImageSensor(NamedTuple):
    """The image sensor's response.

    `gain` (3,) is on red, green, blue; `curve` maps 4 * value to the output, empty for none;
    `noise` is the standard deviation in grey levels, `seed` that of this picture.
    """

    gain: Doubles
    curve: Singles
    noise: float
    seed: np.uint64


class ImageBuffers(NamedTuple):
    """The finished picture: `image` (height, width, 3), the others (height, width)."""

    image: Bytes
    depth: Singles
    label: Bytes
    instance: Ints


@compile_fast
def cover_rows(
    first: int, last: int, view: PinholeView, lamp: Lamp, ground: Ground, rover: RobotShade,
    textures: TexturePyramid, targets: Targets,
) -> None:  # fmt: skip
    """Complete the drawn rows [first, last) with ground, haze and sky."""
    layer = np.empty(view.width, np.int32)
    place, z = np.zeros((2, view.width)), np.zeros(view.width)
    past, has_rover = np.ones(view.width, np.float32), rover.shade.shape[0] > 0
    light, texels_per_px = np.empty(view.width, np.float32), np.empty(view.width, np.float32)
    sky, clear = np.empty(view.width), np.empty(view.width)
    texels_per_m = ground.repeat_per_m * textures.width[0]
    colour, inverse_depth = targets.colour, targets.inverse_depth
    for drawn in range(first, last):
        find_ground(drawn, view, ground, targets, place, layer)
        if has_rover:
            lift_ground(ground, place, layer, z)
            shade_points(view.width, place[0], place[1], z, rover, past)
        light_ground(drawn, view, lamp, ground, past, inverse_depth, place, layer, light,
                     texels_per_px, texels_per_m)  # fmt: skip
        paint_ground(drawn, textures, ground.repeat_per_m, place, layer, light,
                     texels_per_px, colour)  # fmt: skip
        fade_row(drawn, view, lamp.haze_per_m, inverse_depth, sky, clear, colour)


@compile_fast
def develop_rows(
    first: int, last: int, fine: int, targets: Targets, sensor: ImageSensor, picture: ImageBuffers
) -> None:
    """Make the rows [first, last) of the picture from `fine` times as many drawn rows."""
    width = picture.image.shape[1]
    bits, value, grain = np.empty(width, np.uint64), np.empty(3 * width), np.zeros(3 * width)
    image = picture.image.reshape(-1)
    for row in range(first, last):
        choose_row(row, fine, targets.inverse_depth, targets.label, targets.instance, picture)
        average_row(row, fine, targets.colour, value)
        expose_row(sensor.gain, sensor.curve, value)
        if sensor.noise > 0.0:
            scatter_grain(sensor.seed + np.uint64(row * width), sensor.noise, bits, grain)
        write_row(np.uintp(row * width * 3), value, grain, image)


@compile_fast
def fade_row(
    row: int, view: PinholeView, haze_per_m: float, inverse_depth: Singles, sky: Doubles,
    clear: Doubles, colour: Singles,
) -> None:  # fmt: skip
    """Draw the sky where nothing is, and fade distant things into its colour.

    `sky` and `clear` (width,) are buffers: the shares of the zenith's and of the thing's colour.
    """
    turn = view.camera_from_map
    down = (row - view.cy_px) / view.focal_px
    up_0, up_step = turn[1, 2] * down + turn[2, 2], turn[0, 2]
    flat, width = colour.reshape(-1), view.width
    for column in range(width):
        right = (column - view.cx_px) / view.focal_px
        up = up_0 + up_step * right
        sky[column] = min(1.0, max(0.0, 2.0 * up / math.sqrt(right * right + down * down + 1.0)))
        near = inverse_depth[row, column]
        clear[column] = near / (near + haze_per_m) if near > 0.0 else 0.0
    at = np.uintp(3 * row * width)
    for column in range(width):
        red, green = 217.0 - 77.0 * sky[column], 229.0 - 50.0 * sky[column]
        blue, share = 242.0 - 12.0 * sky[column], clear[column]
        flat[at] = red + (flat[at] - red) * share
        flat[at + np.uintp(1)] = green + (flat[at + np.uintp(1)] - green) * share
        flat[at + np.uintp(2)] = blue + (flat[at + np.uintp(2)] - blue) * share
        at += np.uintp(3)


@compile_fast
def choose_row(
    row: int, fine: int, inverse_depth: Singles, label: Bytes, instance: Ints, picture: ImageBuffers
) -> None:
    """Choose depth, class and plant of each pixel of a row.

    They are those of the thing that most of its drawn pixels show, the nearer one of equals. The
    inputs are (fine * height, fine * width).
    """
    out_depth, out_label, out_instance = picture.depth, picture.label, picture.instance
    for column in range(out_depth.shape[1]):
        r, c = row * fine, column * fine
        if fine > 1:
            r, c = _find_most_common(r, c, fine, inverse_depth, label, instance)
        near = inverse_depth[r, c]
        out_depth[row, column] = 1.0 / near if near > 0.0 else math.inf
        out_label[row, column] = label[r, c]
        out_instance[row, column] = instance[r, c]


@compile_fast
def _find_most_common(
    top: int, left: int, fine: int, inverse_depth: Singles, label: Bytes, instance: Ints
) -> tuple[int, int]:
    best_votes, best_row, best_column = 0, top, left
    for r in range(top, top + fine):
        for c in range(left, left + fine):
            votes = 0
            for other_r in range(top, top + fine):
                for other_c in range(left, left + fine):
                    if (
                        instance[other_r, other_c] == instance[r, c]
                        and label[other_r, other_c] == label[r, c]
                    ):
                        votes += 1
            nearer = inverse_depth[r, c] > inverse_depth[best_row, best_column]
            if votes > best_votes or (votes == best_votes and nearer):
                best_votes, best_row, best_column = votes, r, c
    return best_row, best_column


@compile_fast
def average_row(row: int, fine: int, colour: Singles, value: Doubles) -> None:
    """Average red, green, blue of the drawn pixels of each pixel into `value` (3 * width,)."""
    if fine == 1:
        drawn = colour.reshape(-1)
        at = np.uintp(row * value.shape[0])
        for k in range(value.shape[0]):
            value[k] = drawn[at]
            at += np.uintp(1)
        return
    share = 1.0 / (fine * fine)
    for column in range(value.shape[0] // 3):
        for k in range(3):
            total = 0.0
            for r in range(row * fine, (row + 1) * fine):
                for c in range(column * fine, (column + 1) * fine):
                    total += colour[r, c, k]
            value[3 * column + k] = total * share


@compile_fast
def expose_row(gain: Doubles, curve: Singles, value: Doubles) -> None:
    """Apply gain (3,) and tone curve to `value` (3 * width,) in place."""
    red, green, blue = gain[0], gain[1], gain[2]
    for k in range(0, value.shape[0], 3):
        value[k] *= red
        value[k + 1] *= green
        value[k + 2] *= blue
    if curve.shape[0] > 0:
        for k in range(value.shape[0]):
            value[k] = curve[min(max(int(value[k] * CURVE_STEPS + 0.5), 0), curve.shape[0] - 1)]


@compile_fast
def scatter_grain(seed: np.uint64, noise: float, bits: Counters, grain: Doubles) -> None:
    """Write the noise of a row into `grain` (3 * width,).

    For each colour it is the sum of three even numbers of 7 bits, mean 190.5, deviation 64.0.
    """
    for column in range(bits.shape[0]):
        bits[column] = _mix_bits(seed + np.uint64(column))
    scale, low = noise / 64.0, np.uint64(127)
    for column in range(bits.shape[0]):
        for k in range(3):
            part = bits[column] >> np.uint64(21 * k)
            total = (part & low) + ((part >> np.uint64(7)) & low) + ((part >> np.uint64(14)) & low)
            grain[3 * column + k] = (np.int64(total) - 190.5) * scale


@compile_fast
def write_row(at: np.uintp, value: Doubles, grain: Doubles, image: Bytes) -> None:
    """Write `value` plus `grain`, (3 * width,), as 8 bits from index `at` of a flat image on."""
    for k in range(value.shape[0]):
        image[at] = np.uint8(min(255.0, max(0.0, value[k] + grain[k] + 0.5)))
        at += np.uintp(1)


@inline_fast
def _mix_bits(state: np.uint64) -> np.uint64:
    """Mix a counter to 63 random bits. Source: Steele et al. 2014, SplitMix64."""
    z = state * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    mixed: np.uint64 = (z ^ (z >> np.uint64(31))) >> np.uint64(1)
    return mixed
