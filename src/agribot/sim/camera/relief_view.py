"""Rough ground in a picture: where each ray meets it, what it hides, and how it is lit.

Relief mapping (Policarpo, Oliveira, Comba 2005) on the height grid of the wheels: rays walk in
steps over the heights and a secant finds where they go under. Rays of a lattice of every fourth
row and column do so; between them the ground is interpolated where it is smooth, and the lattice
is refined, down to pixels, where it is not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agribot.core.messages import PlantClass
from agribot.sim.camera.arrays import (
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
COARSE = 4  # pixels between the first rays of a band
BACK_M = 0.01  # distance from a ray's start to the end of the one below it
SMOOTH_M = 0.006  # heights between four rays that differ by less are interpolated
SHORT_M = 0.05  # length of the ground between two coarse rays, along the view
LEVEL_UP = -0.08  # rays that fall less are never interpolated
STEEPNESS = 0.7  # slopes of the ground that steps allow for
MOST_STEPS = 64
UNASKED = math.inf


class Band(NamedTuple):
    """A band of rows while its ground is found, (BAND + 1, columns + 1).

    `near` is inverse depth, `level` height over the map's plane, at pixels whose ray was walked;
    `start` the depth from which one is to be walked, UNASKED if it is not. `rays` (n, 2) lists
    line and column of those to walk next.
    """

    near: Singles
    level: Singles
    start: Singles
    rays: Ints


@compile_fast
def draw_relief(
    first_band: int, last_band: int, view: PinholeView, relief: ReliefMap, targets: Targets
) -> None:
    """Draw the ground on the bands of BAND rows, before and behind the things drawn already."""
    columns = (view.width + COARSE - 1) // COARSE * COARSE
    size = (BAND + 1, columns + 1)
    near, level = np.zeros(size, np.float32), np.zeros(size, np.float32)
    start, rays = np.zeros(size, np.float32), np.zeros((size[0] * size[1], 2), np.int32)
    cells, parts = np.zeros_like(rays), np.zeros_like(rays)
    found = Band(near, level, start, rays)
    for band in range(first_band, last_band):
        top = band * BAND
        if not _can_see_ground(top, columns, view, relief.top_m):
            continue
        near[:], start[:] = 0.0, UNASKED
        asked, count = _open_cells(top, view, relief.top_m, targets.inverse_depth, found, cells)
        stride = int(COARSE)  # numba compiles what is called with a literal apart
        while stride > 1:
            _walk_rays(stride, asked, top, found, view, relief, targets)
            asked, count = _fill_cells(stride, count, top, found, cells, parts, view, targets)
            cells, parts = parts, cells
            stride //= 2
        _walk_rays(stride, asked, top, found, view, relief, targets)
        _show_band(top, near, view, targets)


@compile_fast
def _can_see_ground(top: int, columns: int, view: PinholeView, top_m: float) -> bool:
    """Return whether a ray of a band comes down to the highest ground in sight."""
    turn, lowest = view.camera_from_map, 0.0
    for row in (top, top + BAND):
        for column in (0, columns):
            right = (column - view.cx_px) / view.focal_px
            down = (row - view.cy_px) / view.focal_px
            lowest = min(lowest, turn[0, 2] * right + turn[1, 2] * down + turn[2, 2])
    return bool(view.eye[2] + lowest * view.far_m < top_m)


@compile_fast
def _open_cells(
    top: int, view: PinholeView, top_m: float, inverse_depth: Singles, found: Band, cells: Ints
) -> tuple[int, int]:
    """List the coarse cells in which ground may be seen, and the rays of their corners.

    It may not where things hide all of the plane through the highest ground. Returns the numbers
    of rays, from the nearest up, and of cells.
    """
    near, start, rays = found.near, found.start, found.rays
    width, is_upright = view.width, view.camera_from_map[1, 2] < 0.0
    lines, columns = near.shape[0] - 1, near.shape[1] - 1
    spare = np.empty(columns, np.float32)  # margin of inverse depth by which a column is hidden
    asked, count = 0, 0
    for line in range(0, min(lines, view.height - top), COARSE):
        spare[:] = math.inf
        for row in range(top + line, min(top + line + COARSE, view.height)):
            _compare_with_plane(row, width, view, top_m, inverse_depth, spare)
        for column in range(0, columns, COARSE):
            least = spare[column]
            for k in range(1, COARSE):
                least = min(least, spare[column + k])
            if least < 0.0:
                cells[count, 0], cells[count, 1] = line, column
                count += 1
                start[line, column] = start[line, column + COARSE] = 0.0
                start[line + COARSE, column] = start[line + COARSE, column + COARSE] = 0.0
    for step in range(0, lines + 1, COARSE):
        line = lines - step if is_upright else step
        for column in range(0, columns + 1, COARSE):
            if start[line, column] < UNASKED:
                rays[asked, 0], rays[asked, 1] = line, column
                asked += 1
    return asked, count


@compile_fast
def _compare_with_plane(
    row: int, width: int, view: PinholeView, top_m: float, inverse_depth: Singles, spare: Singles
) -> None:
    """Lower `spare` (columns,) to how far things are before the level `top_m`, negative behind."""
    turn, focal, over_m = view.camera_from_map, view.focal_px, view.eye[2] - top_m
    down = (row - view.cy_px) / focal
    first, step = math.inf, 0.0
    if over_m > 0.0:
        step = -turn[0, 2] / (focal * over_m)
        first = -(turn[1, 2] * down + turn[2, 2]) / over_m - step * view.cx_px
    plane, ahead, behind = np.float32(first), np.float32(step), np.float32(-1.0)
    for column in range(width):
        thing = inverse_depth[row, column]
        before = thing - (plane + ahead * np.float32(column)) if thing > 0.0 else behind
        spare[column] = min(spare[column], before)


@compile_fast
def _walk_rays(
    stride: int, count: int, top: int, found: Band, view: PinholeView, relief: ReliefMap,
    targets: Targets,
) -> None:  # fmt: skip
    """Walk the first `count` listed rays; coarse ones from where the one below them ended."""
    near, level, start, rays = found.near, found.level, found.start, found.rays
    height, levels = relief.height, relief.levels
    x_m, y_m, per_m = relief.x_m, relief.y_m, 1.0 / relief.step_m
    turn, eye_x, eye_y, eye_z = view.camera_from_map, view.eye[0], view.eye[1], view.eye[2]
    focal, cx, cy = view.focal_px, view.cx_px, view.cy_px
    near_m, far_m, top_m = view.near_m, view.far_m, relief.top_m
    inverse_depth, last_row, last_column = targets.inverse_depth, view.height - 1, view.width - 1
    reached = np.zeros(near.shape[1])
    for k in range(count):
        line, column = rays[k, 0], rays[k, 1]
        right, down = (column - cx) / focal, (top + line - cy) / focal
        east = turn[0, 0] * right + turn[1, 0] * down + turn[2, 0]
        north = turn[0, 1] * right + turn[1, 1] * down + turn[2, 1]
        up = turn[0, 2] * right + turn[1, 2] * down + turn[2, 2]
        begin = reached[column] if stride == COARSE else float(start[line, column])
        thing, limit = inverse_depth[min(top + line, last_row), min(column, last_column)], far_m
        if thing > 0.0 and (stride == 1 or up >= LEVEL_UP):  # others are corners of what is seen
            limit = 1.0 / thing
        depth = walk(
            east, north, up, begin - BACK_M, limit, eye_x, eye_y, eye_z, near_m, top_m, focal,
            height, levels, x_m, y_m, per_m,
        )  # fmt: skip
        reached[column] = depth if depth > 0.0 else limit
        near[line, column] = 1.0 / depth if depth > 0.0 else 0.0
        level[line, column] = eye_z + up * depth


@compile_fast
def _fill_cells(
    stride: int, count: int, top: int, found: Band, cells: Ints, parts: Ints, view: PinholeView,
    targets: Targets,
) -> tuple[int, int]:  # fmt: skip
    """Interpolate the smooth ones of `count` cells; list rays in the others, and their quarters.

    The inverse depth of a plane is linear in the picture. Returns the numbers of rays and quarters.
    """
    turn, focal, inverse_depth = view.camera_from_map, view.focal_px, targets.inverse_depth
    near, level, start, rays = found.near, found.level, found.start, found.rays
    share = np.float32(1.0 / stride)
    asked = split = 0 * stride  # no literals, as above
    for cell in range(count):
        line, column = cells[cell, 0], cells[cell, 1]
        a, b = near[line, column], near[line, column + stride]
        c, d = near[line + stride, column], near[line + stride, column + stride]
        p, q = level[line, column], level[line, column + stride]
        r, s = level[line + stride, column], level[line + stride, column + stride]
        far, most = min(a, b, c, d), max(a, b, c, d)
        right, down = (column - view.cx_px) / focal, (top + line - view.cy_px) / focal
        up = turn[0, 2] * right + turn[1, 2] * down + turn[2, 2]
        is_smooth = max(p, q, r, s) - min(p, q, r, s) < SMOOTH_M and up < LEVEL_UP
        is_short = stride < COARSE or stride < -up * SHORT_M * focal * far
        if far > 0.0 and is_smooth and is_short:
            for k in range(stride):
                value, end = a + (c - a) * share * k, b + (d - b) * share * k
                ahead = (end - value) * share
                for j in range(stride):
                    near[line + k, column + j] = value + ahead * j
            continue
        begin = _choose_start(top + line, column, stride, far, most, inverse_depth)
        if begin < UNASKED:
            asked, split = _split_cell(
                line, column, stride, begin, start, rays, parts, asked, split
            )
    return asked, split


@compile_fast
def _choose_start(
    row: int, column: int, stride: int, far: float, most: float, inverse_depth: Singles
) -> float:
    """Return the depth to walk from in a cell between rays; UNASKED where things hide it.

    Of its corners the least and greatest inverse depths are `far` and `most`, 0 for none.
    """
    height, width = inverse_depth.shape
    thing = np.float32(math.inf)
    for r in range(row, min(row + stride, height)):
        for c in range(column, min(column + stride, width)):
            thing = min(thing, inverse_depth[r, c])
    is_hidden = thing > 0.0 and most == 0.0
    if far > 0.0:
        is_hidden = thing * (1.0 - BACK_M * most) > most
    if is_hidden:
        return UNASKED
    return 1.0 / most if far > 0.0 else 0.0


@compile_fast
def _split_cell(
    line: int, column: int, stride: int, begin: float, start: Singles, rays: Ints, parts: Ints,
    asked: int, split: int,
) -> tuple[int, int]:  # fmt: skip
    """List the rays halfway between the corners of a cell, and its quarters unless they are pixels.

    A pixel belongs to the cell whose first corner it is or lies in.
    """
    half = stride // 2
    end = stride if half > 1 else half
    for k in range(0, end + 1, half):
        for j in range(0, end + 1, half):
            if half > 1 and k < stride and j < stride:
                parts[split, 0], parts[split, 1] = line + k, column + j
                split += 1
            if half not in (k, j):
                continue
            if start[line + k, column + j] == UNASKED:
                rays[asked, 0], rays[asked, 1] = line + k, column + j
                asked += 1
            start[line + k, column + j] = min(start[line + k, column + j], begin)
    return asked, split


@compile_fast
def _show_band(top: int, near: Singles, view: PinholeView, targets: Targets) -> None:
    """Show the ground of a band, inverse depths `near`, where nothing is before it."""
    inverse_depth, labels, instances = targets.inverse_depth, targets.label, targets.instance
    for row in range(top, min(top + BAND, view.height)):
        for column in range(view.width):
            value, thing = near[row - top, column], inverse_depth[row, column]
            is_nearer = value > thing
            inverse_depth[row, column] = value if is_nearer else thing
            labels[row, column] = SOIL if is_nearer else labels[row, column]
            instances[row, column] = TERRAIN if is_nearer else instances[row, column]


@inline_fast
def pick_copy(wide: float, last: int) -> int:
    """Return the first copy of the heights, each of half the samples, whose cells are so wide."""
    copy = 0
    while wide > 1.0 and copy < last:
        wide *= 0.5
        copy += 1
    return copy


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
        copy = pick_copy(wide, levels.shape[0] - 1)
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
    columns, rows, coarser = block.shape[1] * BLOCK, block.shape[0] * BLOCK, per_m / texels_per_m
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
        sun = 1.0
        if 0 < c < columns and 0 < r < rows:
            here = block[r >> BLOCK_BITS, c >> BLOCK_BITS]
            if here >= 0:
                sun = shade[here, r & (BLOCK - 1), c & (BLOCK - 1)] * (1.0 / 255.0)
        sun = min(sun, past[column])
        covered, seam, copy, scale = covered * coarser, SEAM[row & 3, column & 3], 0, per_m
        while covered > seam and copy < levels.shape[0] - 1:
            covered, scale = covered * 0.5, scale * 0.5
            copy += 1
        wide = levels[copy, 2]
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
