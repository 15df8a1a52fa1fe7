"""Filling of triangles: nearest surface, texture, class and plant of every pixel.

Pixel centres have integer coordinates. Bands of rows are independent of each other, so that
the picture does not depend on how they are shared among threads.
"""

from __future__ import annotations

import math

import numpy as np

from agribot.core.messages import PlantClass
from agribot.sim.camera.arrays import (
    Bytes,
    Doubles,
    Floats,
    Forms,
    Instances,
    Ints,
    Longs,
    PinholeView,
    Singles,
    Targets,
    TexturePyramid,
)
from agribot.sim.camera.projection import COLUMN, DEPTH, ROW, SHADE, U, V
from agribot.sim.jit import compile_fast, inline_fast

SOIL = int(PlantClass.SOIL)
SMALL_BOX_PX = (
    400  # largest box that is searched for a free pixel; in a larger one drawing is cheaper
)
SMALL_TRIANGLE_PX = 200
CLEARLY = 1.000001  # ratio of nearness above the rounding of single precision


@compile_fast
def draw_band(
    first_row: int,
    last_row: int,
    seen: Longs,
    mesh: Longs,
    start: Longs,
    forms: Forms,
    things: Instances,
    view: PinholeView,
    textures: TexturePyramid,
    point: Singles,
    box: Singles,
    targets: Targets,
) -> None:
    """Clear the rows [first_row, last_row); draw what is seen: `point` (V, 6), `box` (N, 5)."""
    inverse_depth, first_face, faces = targets.inverse_depth, forms.first_face, forms.faces
    face, near_m, width = forms.face, view.near_m, view.width
    # Arrays are taken out of their tuples once: their reference counts cost more than a triangle.
    colours, nearness = targets.colour.reshape(-1), inverse_depth.reshape(-1)
    labels, instances = targets.label.reshape(-1), targets.instance.reshape(-1)
    tint, layers, label, identity = things.tint, things.layer, things.label, things.id
    texel, level_first = textures.texel, textures.first
    columns, rows = textures.width, textures.height
    _clear(first_row, last_row, inverse_depth, targets.label, targets.instance)
    corner = np.empty((4, 6))
    for k in range(seen.shape[0]):
        if box[k, 2] > last_row - 1 or box[k, 3] < first_row:
            continue
        if box[k, 0] > width - 1 or box[k, 1] < 0.0:
            continue
        if _is_hidden(box, k, first_row, last_row, inverse_depth):
            continue
        i = seen[k]
        red, green, blue = tint[i, 0], tint[i, 1], tint[i, 2]
        for t in range(first_face[mesh[k]], first_face[mesh[k]] + faces[mesh[k]]):
            a, b, c = start[k] + face[t, 0], start[k] + face[t, 1], start[k] + face[t, 2]
            if min(point[a, DEPTH], point[b, DEPTH], point[c, DEPTH]) >= near_m:
                low = min(point[a, ROW], point[b, ROW], point[c, ROW])
                high = max(point[a, ROW], point[b, ROW], point[c, ROW])
                if high < first_row or low > last_row - 1 or math.ceil(low) > math.floor(high):
                    continue
                _fill(point, a, b, c, first_row, last_row, width, red, green, blue, layers[i],
                      label[i], identity[i], texel, level_first, columns, rows, colours, nearness,
                      labels, instances)  # fmt: skip
                continue
            count = clip(point, a, b, c, view, corner)
            for e in range(1, count - 1):
                _fill_cut(corner, 0, e, e + 1, i, first_row, last_row, things, textures, targets)


@compile_fast
def _clear(
    first_row: int, last_row: int, inverse_depth: Singles, labels: Bytes, instances: Ints
) -> None:
    for row in range(first_row, last_row):
        for column in range(inverse_depth.shape[1]):
            inverse_depth[row, column] = 0.0
            labels[row, column] = SOIL
            instances[row, column] = -1


@compile_fast
def _is_hidden(box: Singles, k: int, first_row: int, last_row: int, inverse_depth: Singles) -> bool:
    """Return whether nearer things cover the whole box of a small thing."""
    width = inverse_depth.shape[1]
    left, right = max(0, int(box[k, 0])), min(width - 1, math.ceil(box[k, 1]))
    top, bottom = max(first_row, int(box[k, 2])), min(last_row - 1, math.ceil(box[k, 3]))
    if (right - left) * (bottom - top) > SMALL_BOX_PX:
        return False
    nearest = 1.0 / box[k, 4]
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            if inverse_depth[row, column] < nearest:
                return False
    return True


@compile_fast
def clip(point: Floats, a: int, b: int, c: int, view: PinholeView, corner: Doubles) -> int:
    """Cut a triangle of `point` (V, 6) at the near plane; write its corners into `corner` (4, 6).

    Returns the number of corners: 0, 3 or 4.
    """
    index = (a, b, c)
    count = 0
    for e in range(3):
        p, q = point[index[e]], point[index[(e + 1) % 3]]
        p_right, p_down = _find_camera_xy(p, view)
        if p[DEPTH] >= view.near_m:
            _write_corner(corner[count], p_right, p_down, p[DEPTH], p[U], p[V], p[SHADE], view)
            count += 1
        if (p[DEPTH] >= view.near_m) != (q[DEPTH] >= view.near_m):
            q_right, q_down = _find_camera_xy(q, view)
            s = (view.near_m - p[DEPTH]) / (float(q[DEPTH]) - p[DEPTH])
            _write_corner(
                corner[count], p_right + s * (q_right - p_right), p_down + s * (q_down - p_down),
                view.near_m, p[U] + s * (q[U] - p[U]), p[V] + s * (q[V] - p[V]),
                p[SHADE] + s * (q[SHADE] - p[SHADE]), view,
            )  # fmt: skip
            count += 1
    return count


@compile_fast
def _find_camera_xy(p: Floats, view: PinholeView) -> tuple[float, float]:
    """Return metres right and down of a vertex; those behind the near plane are stored so."""
    if p[DEPTH] < view.near_m:
        return float(p[COLUMN]), float(p[ROW])
    metres = p[DEPTH] / view.focal_px
    return (p[COLUMN] - view.cx_px) * metres, (p[ROW] - view.cy_px) * metres


@compile_fast
def _write_corner(
    corner: Doubles, right: float, down: float, depth: float, u: float, v: float, shade: float,
    view: PinholeView,
) -> None:  # fmt: skip
    corner[COLUMN] = view.cx_px + view.focal_px * right / depth
    corner[ROW] = view.cy_px + view.focal_px * down / depth
    corner[DEPTH] = depth
    corner[U], corner[V], corner[SHADE] = u, v, shade


@compile_fast
def _fill_cut(
    corner: Doubles, a: int, b: int, c: int, i: int, first_row: int, last_row: int,
    things: Instances, textures: TexturePyramid, targets: Targets,
) -> None:  # fmt: skip
    """Draw a part of a triangle that the near plane cut; rare, so not part of the main loop."""
    tint, width = things.tint, targets.label.shape[1]
    _fill(corner, a, b, c, first_row, last_row, width, tint[i, 0], tint[i, 1], tint[i, 2],
          things.layer[i], things.label[i], things.id[i], textures.texel, textures.first,
          textures.width, textures.height, targets.colour.reshape(-1),
          targets.inverse_depth.reshape(-1), targets.label.reshape(-1),
          targets.instance.reshape(-1))  # fmt: skip


@inline_fast
def _fill(
    point: Floats, a: int, b: int, c: int, first_row: int, last_row: int, width: int,
    red: float, green: float, blue: float, layer: int, label: int, identity: int, texel: Singles,
    level_first: Longs, level_columns: Longs, level_rows: Longs, colours: Singles,
    nearness: Singles, labels: Bytes, instances: Ints,
) -> None:  # fmt: skip
    """Draw one triangle, with perspective-correct texture of the level that fits its size."""
    xa, xb, xc = float(point[a, COLUMN]), float(point[b, COLUMN]), float(point[c, COLUMN])
    ya, yb, yc = float(point[a, ROW]), float(point[b, ROW]), float(point[c, ROW])
    left, right = _find_pixel_range(xa, xb, xc, 0, width)
    top, bottom = _find_pixel_range(ya, yb, yc, first_row, last_row)
    area = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)
    if left <= right and top <= bottom and area != 0.0:
        wa, wb, wc = 1.0 / point[a, DEPTH], 1.0 / point[b, DEPTH], 1.0 / point[c, DEPTH]
        if not _is_covered(left, right, top, bottom, width, max(wa, wb, wc), nearness):
            per_area = 1.0 / area
            ua, ub, uc = float(point[a, U]), float(point[b, U]), float(point[c, U])
            va, vb, vc = float(point[a, V]), float(point[b, V]), float(point[c, V])
            share = abs(((ub - ua) * (vc - va) - (uc - ua) * (vb - va)) * per_area)
            level = _pick_level(share * level_columns[0] * level_rows[0], level_first.shape[0] - 1)
            columns, rows, first = level_columns[level], level_rows[level], level_first[level]
            ua, ub, uc = ua * wa * columns, ub * wb * columns, uc * wc * columns
            va, vb, vc = va * wa * rows, vb * wb * rows, vc * wc * rows
            sa, sb, sc = float(point[a, SHADE]), float(point[b, SHADE]), float(point[c, SHADE])
            da, db, dc = (yb - yc) * per_area, (yc - ya) * per_area, (ya - yb) * per_area
            ca, cb, cc, wide = solve_zero(da), solve_zero(db), solve_zero(dc), float(right - left)
            near_step, shade_step = da * wa + db * wb + dc * wc, da * sa + db * sb + dc * sc
            u_step, v_step = da * ua + db * ub + dc * uc, da * va + db * vb + dc * vc
            for row in range(top, bottom + 1):
                start_a = ((xb - left) * (yc - row) - (xc - left) * (yb - row)) * per_area
                start_b = ((xc - left) * (ya - row) - (xa - left) * (yc - row)) * per_area
                start_c = 1.0 - start_a - start_b
                low, high = find_inside(start_a, start_b, start_c, da, db, dc, ca, cb, cc, wide)
                near_0, at_0 = start_a * wa + start_b * wb + start_c * wc, row * width + left
                shade_0 = start_a * sa + start_b * sb + start_c * sc
                u_0 = start_a * ua + start_b * ub + start_c * uc
                v_0 = start_a * va + start_b * vb + start_c * vc
                for step in range(low, high + 1):
                    near = near_0 + step * near_step
                    at = np.uintp(at_0 + step)
                    if near > nearness[at]:
                        u = _find_texel((u_0 + step * u_step) / near, columns)
                        v = _find_texel((v_0 + step * v_step) / near, rows)
                        cell = np.uintp(first + v * columns + u)
                        shade, rgb = shade_0 + step * shade_step, np.uintp(3) * at
                        colours[rgb] = texel[layer, cell, 0] * shade * red
                        colours[rgb + np.uintp(1)] = texel[layer, cell, 1] * shade * green
                        colours[rgb + np.uintp(2)] = texel[layer, cell, 2] * shade * blue
                        nearness[at], labels[at], instances[at] = near, label, identity


@inline_fast
def _find_pixel_range(a: float, b: float, c: float, first: int, end: int) -> tuple[int, int]:
    """Return the first and last row or column in [first, end) between three corners."""
    low, high = max(float(first), min(a, b, c)), min(end - 1.0, max(a, b, c))
    return math.ceil(low), math.floor(high)


@inline_fast
def _find_texel(at: float, count: int) -> int:
    return min(max(int(at), 0), count - 1)


@inline_fast
def _is_covered(
    left: int, right: int, top: int, bottom: int, width: int, nearest: float,
    nearness: Singles,
) -> bool:  # fmt: skip
    """Return whether nearer things cover the whole box of a small triangle."""
    wanted = np.float32(CLEARLY * nearest)
    if (right - left) * (bottom - top) > SMALL_TRIANGLE_PX:
        return False
    for row in range(top, bottom + 1):
        at = np.uintp(row * width + left)
        for _ in range(left, right + 1):
            if nearness[at] < wanted:
                return False
            at += np.uintp(1)
    return True


@inline_fast
def _pick_level(texels_per_px: float, last: int) -> int:
    """Choose the copy of a texture with about one texel to a pixel, by the ratio of areas."""
    level = 0
    while texels_per_px > 2.0 and level < last:
        texels_per_px *= 0.25
        level += 1
    return level


@inline_fast
def solve_zero(slope: float) -> float:
    return 0.0 if slope == 0.0 else -1.0 / slope


@inline_fast
def find_inside(
    start_a: float, start_b: float, start_c: float, da: float, db: float, dc: float,
    ca: float, cb: float, cc: float, width: float,
) -> tuple[int, int]:  # fmt: skip
    """Return the first and last step up to `width` where no barycentric coordinate is negative.

    They start as `start_a`, change by `da` a step and cross zero `ca` times `start_a` steps on.
    """
    low, high = _clip_span(start_a, da, ca, 0.0, width)
    low, high = _clip_span(start_b, db, cb, low, high)
    low, high = _clip_span(start_c, dc, cc, low, high)
    return math.ceil(low - 1e-6), math.floor(high + 1e-6)


@inline_fast
def _clip_span(
    start: float, slope: float, crossing: float, low: float, high: float
) -> tuple[float, float]:
    """Return the part of [low, high] where start + slope * x >= 0; empty if high < low."""
    if slope > 0.0:
        low = max(low, start * crossing)
    elif slope < 0.0:
        high = min(high, start * crossing)
    elif start < 0.0:
        high = low - 1.0
    return low, high
