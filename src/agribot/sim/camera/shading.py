"""What is left after the plants: ground, sky and haze; then the sensor that takes the picture."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agribot.sim.camera.arrays import (
    Bytes,
    Doubles,
    Ground,
    Ints,
    Lamp,
    Pyramid,
    RobotShade,
    Singles,
    Targets,
    View,
)
from agribot.sim.camera.ground import find_ground, lift_ground, light_ground, paint_ground
from agribot.sim.camera.jit import compiled, inlined
from agribot.sim.camera.robot_shadow import shade_points

CURVE_STEPS = 4  # entries of the tone curve for each grey level


class Sensor(NamedTuple):
    """`gain` (3,) on red, green, blue; `curve` maps 4 * value to the output, empty for none;
    `noise` is the standard deviation in grey levels, `seed` that of this picture.
    """

    gain: Doubles
    curve: Singles
    noise: float
    seed: np.uint64


class Picture(NamedTuple):
    image: Bytes
    depth: Singles
    label: Bytes
    instance: Ints


@compiled
def cover_rows(
    first: int, last: int, view: View, lamp: Lamp, ground: Ground, rover: RobotShade,
    textures: Pyramid, targets: Targets,
) -> None:  # fmt: skip
    """Complete the drawn rows [first, last) with ground, haze and sky."""
    layer = np.empty(view.width, np.int32)
    place, z = np.zeros((2, view.width)), np.zeros(view.width)
    past, has_rover = np.ones(view.width, np.float32), rover.shade.shape[0] > 0
    light, texels_per_px = np.empty(view.width, np.float32), np.empty(view.width, np.float32)
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
        fade_row(drawn, view, lamp.haze_per_m, inverse_depth, colour)


@compiled
def develop_rows(
    first: int, last: int, fine: int, targets: Targets, sensor: Sensor, picture: Picture
) -> None:
    """Make the rows [first, last) of the picture from `fine` times as many drawn rows."""
    for row in range(first, last):
        choose_row(row, fine, targets.inverse_depth, targets.label, targets.instance, picture)
        expose_row(row, fine, targets.colour, sensor, picture.image)


@compiled
def fade_row(
    row: int, view: View, haze_per_m: float, inverse_depth: Singles, colour: Singles
) -> None:
    """Sky where nothing is, and its colour over what is far."""
    turn = view.camera_from_map
    down = (row - view.cy_px) / view.focal_px
    for column in range(view.width):
        right = (column - view.cx_px) / view.focal_px
        up = turn[0, 2] * right + turn[1, 2] * down + turn[2, 2]
        sky = min(1.0, max(0.0, 2.0 * up / math.sqrt(right * right + down * down + 1.0)))
        red, green, blue = 217.0 - 77.0 * sky, 229.0 - 50.0 * sky, 242.0 - 12.0 * sky
        near = inverse_depth[row, column]
        if near > 0.0:
            clear = near / (near + haze_per_m)
            red += (colour[row, column, 0] - red) * clear
            green += (colour[row, column, 1] - green) * clear
            blue += (colour[row, column, 2] - blue) * clear
        colour[row, column, 0] = red
        colour[row, column, 1] = green
        colour[row, column, 2] = blue


@compiled
def choose_row(
    row: int, fine: int, inverse_depth: Singles, label: Bytes, instance: Ints, picture: Picture
) -> None:
    """Depth, class and plant of each pixel: of the thing that most of its drawn pixels show,
    the nearer one of equals.
    """
    out_depth, out_label, out_instance = picture.depth, picture.label, picture.instance
    for column in range(out_depth.shape[1]):
        r, c = row * fine, column * fine
        if fine > 1:
            r, c = _most_common(r, c, fine, inverse_depth, label, instance)
        near = inverse_depth[r, c]
        out_depth[row, column] = 1.0 / near if near > 0.0 else math.inf
        out_label[row, column] = label[r, c]
        out_instance[row, column] = instance[r, c]


@compiled
def _most_common(
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


@compiled
def expose_row(row: int, fine: int, colour: Singles, sensor: Sensor, image: Bytes) -> None:
    """Average the drawn pixels, apply gain, tone curve and noise, and round to 8 bits."""
    gain, curve, noise = sensor.gain, sensor.curve, sensor.noise
    width = image.shape[1]
    share = 1.0 / (fine * fine)
    for column in range(width):
        bits = _mixed_bits(sensor.seed + np.uint64(row * width + column)) if noise > 0 else 0
        for k in range(3):
            value = 0.0
            for r in range(row * fine, (row + 1) * fine):
                for c in range(column * fine, (column + 1) * fine):
                    value += colour[r, c, k]
            value *= gain[k] * share
            if curve.shape[0] > 0:
                value = curve[min(max(int(value * CURVE_STEPS + 0.5), 0), curve.shape[0] - 1)]
            # The sum of three even numbers of 7 bits: mean 190.5, deviation 64.0.
            total = (bits & 127) + ((bits >> 7) & 127) + ((bits >> 14) & 127)
            bits >>= 21
            value += (total - 190.5) * (noise / 64.0)
            image[row, column, k] = np.uint8(min(255.0, max(0.0, value + 0.5)))


@inlined
def _mixed_bits(state: np.uint64) -> int:
    """63 well-mixed bits of a counter. Source: Steele et al. 2014, SplitMix64."""
    z = state * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return int(np.int64((z ^ (z >> np.uint64(31))) >> np.uint64(1)))
