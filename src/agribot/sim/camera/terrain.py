"""Uneven ground in the picture: a mesh of rings around the camera, finer where it is near."""

from __future__ import annotations

import math

import numpy as np

from agribot.core.messages import PlantClass
from agribot.sim.camera.arrays import Bytes, Doubles, Ground, Ints, PinholeView, Singles, Targets
from agribot.sim.camera.ground import TERRAIN, sample_height
from agribot.sim.camera.projection import COLUMN, DEPTH, ROW, U, V
from agribot.sim.camera.raster import clip, find_inside, solve_zero
from agribot.sim.jit import compile_fast

SOIL = int(PlantClass.SOIL)
FIRST_RING_M = 0.05
RING_GROWTH = 1.07
SPOKES = 129
STEEP = 0.55  # looking down more than this, rings are whole circles


def project_terrain(view: PinholeView, ground: Ground) -> Doubles:
    """Project the mesh, (rings, spokes, 6) in the columns of a projected vertex.

    U and V are the map x and y. Behind the near plane, column and row hold camera metres.
    """
    forward = view.camera_from_map[2]
    count = math.ceil(math.log(view.far_m / FIRST_RING_M) / math.log(RING_GROWTH))
    radius_m = np.concatenate([[0.0], FIRST_RING_M * RING_GROWTH ** np.arange(count + 1)])
    angle_rad = np.linspace(-math.pi, math.pi, SPOKES)
    if abs(forward[2]) < STEEP:
        half_view = math.hypot(view.cx_px, view.cy_px) / view.focal_px
        half_rad = min(math.pi, math.atan(half_view / math.sqrt(1.0 - forward[2] ** 2)) + 0.2)
        # The ring under the camera is part of the fan, so that it also covers what is below it.
        angle_rad = math.atan2(forward[1], forward[0]) + np.linspace(-half_rad, half_rad, SPOKES)
    return _project_rings(view, ground, radius_m, angle_rad)


@compile_fast
def _project_rings(
    view: PinholeView, ground: Ground, radius_m: Doubles, angle_rad: Doubles
) -> Doubles:
    point = np.zeros((radius_m.shape[0], angle_rad.shape[0], 6))
    height, turn, eye = ground.height, view.camera_from_map, view.eye
    for ring in range(radius_m.shape[0]):
        for spoke in range(angle_rad.shape[0]):
            east = radius_m[ring] * math.cos(angle_rad[spoke])
            north = radius_m[ring] * math.sin(angle_rad[spoke])
            x, y = eye[0] + east, eye[1] + north
            up = -eye[2] + sample_height(
                height, ground.height_x_m, ground.height_y_m, ground.height_step_m, x, y
            )
            right = turn[0, 0] * east + turn[0, 1] * north + turn[0, 2] * up
            down = turn[1, 0] * east + turn[1, 1] * north + turn[1, 2] * up
            depth = turn[2, 0] * east + turn[2, 1] * north + turn[2, 2] * up
            if depth >= view.near_m:
                right = view.cx_px + view.focal_px * right / depth
                down = view.cy_px + view.focal_px * down / depth
            point[ring, spoke, COLUMN], point[ring, spoke, ROW] = right, down
            point[ring, spoke, DEPTH] = depth
            point[ring, spoke, U], point[ring, spoke, V] = x, y
    return point


@compile_fast
def draw_terrain(
    first_row: int, last_row: int, point: Doubles, view: PinholeView, targets: Targets
) -> None:
    """Draw the mesh (rings, spokes, 6) on the rows [first_row, last_row), behind all things."""
    spokes = point.shape[1]
    flat = point.reshape(-1, 6)
    corner = np.empty((4, 6))
    place, inverse_depth = targets.place, targets.inverse_depth
    for cell in range((point.shape[0] - 1) * (spokes - 1)):
        first = cell // (spokes - 1) * spokes + cell % (spokes - 1)
        for half in range(2):
            a, b, c = first, first + spokes, first + 1
            if half == 1:
                a = first + spokes + 1
            nearest = min(flat[a, DEPTH], flat[b, DEPTH], flat[c, DEPTH])
            if nearest >= view.near_m:
                low = min(flat[a, ROW], flat[b, ROW], flat[c, ROW])
                high = max(flat[a, ROW], flat[b, ROW], flat[c, ROW])
                if low <= last_row - 1 and high >= first_row:
                    _fill(flat, a, b, c, first_row, last_row, place, inverse_depth,
                          targets.label, targets.instance)  # fmt: skip
                continue
            count = clip(flat, a, b, c, view, corner)
            for e in range(1, count - 1):
                _fill(corner, 0, e, e + 1, first_row, last_row, place, inverse_depth,
                      targets.label, targets.instance)  # fmt: skip


@compile_fast
def _fill(
    point: Doubles, a: int, b: int, c: int, first_row: int, last_row: int, place: Doubles,
    inverse_depth: Singles, labels: Bytes, instances: Ints,
) -> None:  # fmt: skip
    """Mark the visible pixels of a triangle as terrain and note where in the map they lie."""
    xa, xb, xc = point[a, COLUMN], point[b, COLUMN], point[c, COLUMN]
    ya, yb, yc = point[a, ROW], point[b, ROW], point[c, ROW]
    area = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)
    if area == 0.0:
        return
    left = math.ceil(max(0.0, min(xa, xb, xc)))
    right = math.floor(min(inverse_depth.shape[1] - 1.0, max(xa, xb, xc)))
    top = math.ceil(max(float(first_row), min(ya, yb, yc)))
    bottom = math.floor(min(last_row - 1.0, max(ya, yb, yc)))
    wa, wb, wc = 1.0 / point[a, DEPTH], 1.0 / point[b, DEPTH], 1.0 / point[c, DEPTH]
    da, db = (yb - yc) / area, (yc - ya) / area
    dc = -da - db
    ca, cb, cc = solve_zero(da), solve_zero(db), solve_zero(dc)
    for row in range(top, bottom + 1):
        start_a = ((xb - left) * (yc - row) - (xc - left) * (yb - row)) / area
        start_b = ((xc - left) * (ya - row) - (xa - left) * (yc - row)) / area
        start_c = 1.0 - start_a - start_b
        low, high = find_inside(
            start_a, start_b, start_c, da, db, dc, ca, cb, cc, float(right - left)
        )
        for step in range(low, high + 1):
            la, lb = start_a + step * da, start_b + step * db
            la, lb, lc = la * wa, lb * wb, (1.0 - la - lb) * wc
            near, column = la + lb + lc, left + step
            if near > inverse_depth[row, column]:
                inverse_depth[row, column] = near
                place[row, column, 0] = (
                    la * point[a, U] + lb * point[b, U] + lc * point[c, U]
                ) / near
                place[row, column, 1] = (
                    la * point[a, V] + lb * point[b, V] + lc * point[c, V]
                ) / near
                labels[row, column] = SOIL
                instances[row, column] = TERRAIN
