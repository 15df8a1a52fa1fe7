"""Rough ground in a picture: where each ray meets it, what it hides, and how it is lit.

Relief mapping (Policarpo, Oliveira, Comba 2005) on the height grid of the wheels: rays walk in
steps over the heights and a secant finds where they go under. Rays of a lattice of every second
row and column do so; between them the ground is interpolated where it is smooth.
"""

from __future__ import annotations

import math

import numpy as np

from agribot.core.messages import PlantClass
from agribot.sim.camera.arrays import (
    Bytes,
    Doubles,
    Ground,
    Ints,
    Lamp,
    Longs,
    PinholeView,
    RobotShade,
    Singles,
    Targets,
    TexturePyramid,
)
from agribot.sim.camera.ground import SEAM, TERRAIN, TONE_SIZE, find_cell, paint_ground
from agribot.sim.camera.relief_map import UNIT, ReliefMap, sample_relief
from agribot.sim.camera.robot_shadow import shade_points
from agribot.sim.camera.shading import fade_row
from agribot.sim.camera.shadows import BLOCK, BLOCK_BITS
from agribot.sim.jit import compile_fast, inline_fast

SOIL = int(PlantClass.SOIL)
BAND = 32  # rows that are walked together, from the nearest up
BACK_M = 0.01  # a ray starts so far before where the one below it ended
SMOOTH_M = 0.006  # heights between four rays that differ by less are interpolated
LEVEL_UP = -0.08  # rays that fall less are never interpolated
STEEPNESS = 0.7  # slopes of the ground that steps allow for
MOST_STEPS = 64


@compile_fast
def draw_relief(
    first_band: int, last_band: int, view: PinholeView, relief: ReliefMap, targets: Targets
) -> None:
    """Draw the ground on the bands of BAND rows, before and behind the things drawn already."""
    height, levels = relief.height, relief.levels
    x_m, y_m, per_m = relief.x_m, relief.y_m, 1.0 / relief.step_m
    turn, eye = view.camera_from_map, view.eye
    eye_x, eye_y, eye_z = eye[0], eye[1], eye[2]
    focal, cx, cy = view.focal_px, view.cx_px, view.cy_px
    near_m, far_m, top_m = view.near_m, view.far_m, relief.top_m
    inverse_depth = targets.inverse_depth
    half = BAND // 2
    columns = view.width // 2 + 1
    depth, level = np.zeros((half + 1, columns)), np.zeros((half + 1, columns))
    reached = np.zeros(columns)
    is_upright = turn[1, 2] < 0.0
    for band in range(first_band, last_band):
        top = band * BAND
        used = (min(BAND, view.height - top) + 1) // 2
        reached[:] = 0.0
        for step in range(used + 1):
            line = used - step if is_upright else step
            row = min(top + 2 * line, view.height - 1)
            down = (top + 2 * line - cy) / focal
            for k in range(columns):
                right = (2 * k - cx) / focal
                east = turn[0, 0] * right + turn[1, 0] * down + turn[2, 0]
                north = turn[0, 1] * right + turn[1, 1] * down + turn[2, 1]
                up = turn[0, 2] * right + turn[1, 2] * down + turn[2, 2]
                thing = inverse_depth[row, min(2 * k, view.width - 1)]
                limit = 1.0 / thing if thing > 0.0 else far_m
                found = walk(
                    east, north, up, reached[k] - BACK_M, limit, eye_x, eye_y, eye_z, near_m, top_m,
                    focal, height, levels, x_m, y_m, per_m,
                )  # fmt: skip
                depth[line, k] = found
                reached[k] = found if found > 0.0 else limit
                level[line, k] = eye_z + up * found
        _fill_band(top, depth, level, view, relief, targets)


@compile_fast
def _fill_band(
    top: int, depth: Doubles, level: Doubles, view: PinholeView, relief: ReliefMap, targets: Targets
) -> None:
    """Complete a band from its lattice of depths and heights (BAND / 2 + 1, columns)."""
    height, levels = relief.height, relief.levels
    x_m, y_m, per_m = relief.x_m, relief.y_m, 1.0 / relief.step_m
    turn, eye_x, eye_y, eye_z = view.camera_from_map, view.eye[0], view.eye[1], view.eye[2]
    focal, cx, cy = view.focal_px, view.cx_px, view.cy_px
    near_m, far_m, top_m = view.near_m, view.far_m, relief.top_m
    inverse_depth, labels, instances = targets.inverse_depth, targets.label, targets.instance
    for row in range(top, min(top + BAND, view.height)):
        line, odd_row = (row - top) >> 1, (row - top) & 1
        down = (row - cy) / focal
        for column in range(view.width):
            k, odd = column >> 1, column & 1
            near = depth[line, k]
            if odd + odd_row > 0:
                second, third = depth[line, k + odd], depth[line + odd_row, k]
                fourth = depth[line + odd_row, k + odd]
                thing = inverse_depth[row, column]
                if thing > 0.0 and max(near, second, third, fourth) == 0.0:
                    continue  # among what hides the ground
                nearest = min(near, second, third, fourth)
                a, b = level[line, k], level[line, k + odd]
                c, d = level[line + odd_row, k], level[line + odd_row, k + odd]
                right = (column - cx) / focal
                up = turn[0, 2] * right + turn[1, 2] * down + turn[2, 2]
                is_smooth = max(a, b, c, d) - min(a, b, c, d) < SMOOTH_M
                if nearest > 0.0 and is_smooth and up < LEVEL_UP:
                    near = (0.25 * (a + b + c + d) - eye_z) / up
                else:
                    east = turn[0, 0] * right + turn[1, 0] * down + turn[2, 0]
                    north = turn[0, 1] * right + turn[1, 1] * down + turn[2, 1]
                    limit = 1.0 / thing if thing > 0.0 else far_m
                    near = walk(
                        east, north, up, nearest - BACK_M, limit, eye_x, eye_y, eye_z, near_m,
                        top_m, focal, height, levels, x_m, y_m, per_m,
                    )  # fmt: skip
            if near > 0.0 and 1.0 / near > inverse_depth[row, column]:
                inverse_depth[row, column] = 1.0 / near
                labels[row, column] = SOIL
                instances[row, column] = TERRAIN


@inline_fast
def rise(
    eye_z: float, up: float, at: float, height: Singles, origin: int, rows: int, columns: int,
    u: float, v: float,
) -> float:  # fmt: skip
    """Return how high a ray is over the ground at a depth, where its column is u and its row v."""
    return eye_z + up * at - sample_relief(height, origin, rows, columns, u, v)


@inline_fast
def cross(at: float, over: float, found: float, middle: float, then: float, under: float) -> float:
    """Return where a ray goes under: it is `over` at one end, `under` at the other."""
    if middle > 0.0:
        return found + (then - found) * middle / (middle - under)
    return at + (found - at) * over / (over - middle)


@inline_fast
def walk(
    east: float, north: float, up: float, start: float, limit: float, eye_x: float, eye_y: float,
    eye_z: float, near_m: float, top_m: float, focal: float, height: Singles, levels: Longs,
    x_m: float, y_m: float, per_m: float,
) -> float:  # fmt: skip
    """Return the depth at which a ray meets the ground, 0 if it does not before `limit`.

    `east`, `north`, `up` is its way for a metre of depth; `start` a depth before the ground.
    """
    first = near_m
    if eye_z > top_m:
        first = max(near_m, (top_m - eye_z) / min(up, -1e-9))
    at, found = max(first, start), 0.0
    if at < limit:
        way, fall = math.sqrt(east * east + north * north) + 1e-9, max(-up, 1e-6)
        # A copy of the heights whose cells are about as large as what a pixel covers.
        wide = max(2.0, 0.25 * way / fall) / focal * per_m * at
        copy = min(max(0, math.ceil(math.log2(wide))), levels.shape[0] - 1)
        origin, rows, columns = levels[copy, 0], levels[copy, 1], levels[copy, 2]
        scale = per_m / (1 << copy)
        u0, v0, du, dv = (eye_x - x_m) * scale, (eye_y - y_m) * scale, east * scale, north * scale
        least = 0.7 / (way * scale)
        over = rise(eye_z, up, at, height, origin, rows, columns, u0 + du * at, v0 + dv * at)
        back = 0.01
        while over <= 0.0 and at > first:
            at = max(first, at - back)
            back *= 2.0
            over = rise(eye_z, up, at, height, origin, rows, columns, u0 + du * at, v0 + dv * at)
        if over <= 0.0:
            found = at
        for _ in range(MOST_STEPS):
            if at >= limit or found > 0.0:
                break
            ahead = max(over / (fall + STEEPNESS * way), least)
            u, v = u0 + du * at, v0 + dv * at
            outside = max(-u, -v, u - columns, v - rows)
            if up < 0.0 and outside > 0.0:
                ahead = max(ahead, over / fall)
            then = at + ahead
            u, v = u0 + du * then, v0 + dv * then
            under = rise(eye_z, up, then, height, origin, rows, columns, u, v)
            if under <= 0.0:
                found = at + ahead * over / (over - under)
                u, v = u0 + du * found, v0 + dv * found
                middle = rise(eye_z, up, found, height, origin, rows, columns, u, v)
                found = cross(at, over, found, middle, then, under)
            at, over = then, under
        if found == 0.0 and up < 0.0 and at < limit:
            found = at + over / fall
    return found if found < limit else 0.0


@compile_fast
def cover_relief_rows(
    first: int, last: int, view: PinholeView, lamp: Lamp, ground: Ground, relief: ReliefMap,
    rover: RobotShade, textures: TexturePyramid, targets: Targets,
) -> None:  # fmt: skip
    """Complete the drawn rows [first, last) with rough ground, haze and sky."""
    layer = np.empty(view.width, np.int32)
    place, z = np.zeros((2, view.width)), np.zeros(view.width)
    past, has_rover = np.ones(view.width, np.float32), rover.shade.shape[0] > 0
    light, texels_per_px = np.empty(view.width, np.float32), np.empty(view.width, np.float32)
    sky, clear = np.empty(view.width), np.empty(view.width)
    texels_per_m = ground.repeat_per_m * textures.width[0]
    colour, inverse_depth = targets.colour, targets.inverse_depth
    for drawn in range(first, last):
        _find_relief(drawn, view, ground, targets, place, z, layer)
        if has_rover:
            shade_points(view.width, place[0], place[1], z, rover, past)
        _light_relief(drawn, view, lamp, ground, relief, past, inverse_depth, place, z, layer,
                      light, texels_per_px, texels_per_m)  # fmt: skip
        paint_ground(drawn, textures, ground.repeat_per_m, place, layer, light,
                     texels_per_px, colour)  # fmt: skip
        fade_row(drawn, view, lamp.haze_per_m, inverse_depth, sky, clear, colour)


@compile_fast
def _find_relief(
    row: int, view: PinholeView, ground: Ground, targets: Targets, place: Doubles, z: Doubles,
    layer: Ints,
) -> None:  # fmt: skip
    """Find map x, y, z and surface of the ground pixels of a row; layer -1 where others are."""
    turn, eye_x, eye_y, eye_z = view.camera_from_map, view.eye[0], view.eye[1], view.eye[2]
    inverse_depth, instance = targets.inverse_depth, targets.instance
    x_edge, y_edge, surface = ground.x_edge, ground.y_edge, ground.surface
    down = (row - view.cy_px) / view.focal_px
    east_0 = turn[1, 0] * down + turn[2, 0]
    north_0 = turn[1, 1] * down + turn[2, 1]
    up_0 = turn[1, 2] * down + turn[2, 2]
    tile_x, tile_y = 0, 0
    for column in range(view.width):
        layer[column] = -1
        if instance[row, column] != TERRAIN:
            continue
        instance[row, column] = -1
        right = (column - view.cx_px) / view.focal_px
        depth = 1.0 / inverse_depth[row, column]
        x = eye_x + (east_0 + turn[0, 0] * right) * depth
        y = eye_y + (north_0 + turn[0, 1] * right) * depth
        place[0, column], place[1, column] = x, y
        z[column] = eye_z + (up_0 + turn[0, 2] * right) * depth
        if not x_edge[tile_x] <= x < x_edge[tile_x + 1]:
            tile_x = find_cell(x_edge, x)
        if not y_edge[tile_y] <= y < y_edge[tile_y + 1]:
            tile_y = find_cell(y_edge, y)
        layer[column] = surface[tile_y, tile_x]


@inline_fast
def find_sun(shade: Bytes, block: Ints, c: int, r: int) -> float:
    """Return the share of the sun at a texel of the shadow map."""
    sun = 1.0
    if 0 < c < block.shape[1] * BLOCK and 0 < r < block.shape[0] * BLOCK:
        here = block[r >> BLOCK_BITS, c >> BLOCK_BITS]
        if here >= 0:
            sun = shade[here, r & (BLOCK - 1), c & (BLOCK - 1)] * (1.0 / 255.0)
    return sun


@compile_fast
def _light_relief(
    row: int, view: PinholeView, lamp: Lamp, ground: Ground, relief: ReliefMap, past: Singles,
    inverse_depth: Singles, place: Doubles, z: Doubles, layer: Ints, light: Singles,
    texels_per_px: Singles, texels_per_m: float,
) -> None:  # fmt: skip
    """Light the ground pixels of a row by sun and sky, as `light_ground` does on smooth ground."""
    shade, block, tone = ground.shade, ground.block, ground.tone
    eye_x, eye_y, eye_z, focal = view.eye[0], view.eye[1], view.eye[2], view.focal_px
    baked, levels = relief.light, relief.light_levels
    x_m, y_m, per_m = relief.x_m, relief.y_m, 1.0 / relief.light_step_m
    per_step, sun_share = 1.0 / ground.shade_step_m, lamp.diffuse * lamp.to_sun[2] / UNIT
    coarser = per_m / texels_per_m
    for column in range(view.width):
        if layer[column] < 0:
            continue
        x, y = place[0, column], place[1, column]
        near = inverse_depth[row, column]
        to_x, to_y, to_z = eye_x - x, eye_y - y, eye_z - z[column]
        steep = to_z / math.sqrt(to_x * to_x + to_y * to_y + to_z * to_z)
        covered = texels_per_m / (focal * near * max(0.25, steep))
        texels_per_px[column] = covered
        c, r = int((x - ground.shade_x_m) * per_step), int((y - ground.shade_y_m) * per_step)
        sun = min(find_sun(shade, block, c, r), past[column])
        covered, seam, copy = covered * coarser, SEAM[row & 3, column & 3], 0
        while covered > seam and copy < levels.shape[0] - 1:
            covered *= 0.5
            copy += 1
        wide, scale = levels[copy, 2], per_m / (1 << copy)
        u = min(max((x - x_m) * scale, 0.0), wide - 1.001)
        v = min(max((y - y_m) * scale, 0.0), levels[copy, 1] - 1.001)
        c, r = int(u), int(v)
        u, v = u - c, v - r
        at = np.uintp(levels[copy, 0] + r * wide + c)
        under = np.uintp(levels[copy, 0] + (r + 1) * wide + c)
        one, zero = np.uintp(1), np.uintp(0)
        p, q = (1.0 - u) * (1.0 - v), u * (1.0 - v)
        s, t = (1.0 - u) * v, u * v
        sunlit = baked[at, zero] * p + baked[at + one, zero] * q
        sunlit += baked[under, zero] * s + baked[under + one, zero] * t
        sky = baked[at, one] * p + baked[at + one, one] * q
        sky += baked[under, one] * s + baked[under + one, one] * t
        tone_x, tone_y = int(x * ground.tone_per_m), int(y * ground.tone_per_m)
        bright = tone[tone_y & (TONE_SIZE - 1), tone_x & (TONE_SIZE - 1)]
        ambient = lamp.ambient * (0.75 + 0.25 * sun) * sky / UNIT
        light[column] = (ambient + sun_share * sunlit * sun) * bright
