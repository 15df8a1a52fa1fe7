"""Selection of the things in a view, and projection of their vertices into the picture."""

from __future__ import annotations

import math

import numpy as np

from agribot.sim.camera.arrays import (
    Doubles,
    Forms,
    Instances,
    Lamp,
    Longs,
    PinholeView,
    RobotShade,
    Singles,
)
from agribot.sim.camera.robot_shadow import shade_points
from agribot.sim.jit import compile_fast, inline_fast

# Columns of a projected vertex. Before the near plane, column and row hold camera metres.
COLUMN, ROW, DEPTH, U, V, SHADE = range(6)
FARTHEST = 1.0e9


@compile_fast
def cull(
    forms: Forms,
    things: Instances,
    view: PinholeView,
    least_px: float,
    depth_m: Singles,
    size_px: Singles,
) -> None:
    """Write distance and apparent size (n,) of the things that may be in view; else depth -1."""
    edge_x = math.sqrt(1.0 + (view.cx_px / view.focal_px) ** 2)
    edge_y = math.sqrt(1.0 + (view.cy_px / view.focal_px) ** 2)
    turn = view.camera_from_map
    for i in range(things.form.shape[0]):
        radius = forms.radius[things.form[i]] * things.scale[i]
        x = things.position[i, 0] - view.eye[0]
        y = things.position[i, 1] - view.eye[1]
        z = things.position[i, 2] - view.eye[2]
        forward = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z
        depth_m[i] = -1.0
        size_px[i] = 0.0
        if forward < view.near_m - radius or forward - radius > view.far_m:
            continue
        right = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z
        down = turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z
        if abs(right) - forward * (view.cx_px + 0.5) / view.focal_px > radius * edge_x:
            continue
        if abs(down) - forward * (view.cy_px + 0.5) / view.focal_px > radius * edge_y:
            continue
        near = max(forward, view.near_m)
        size_px[i] = 2.0 * radius * view.focal_px / near
        if size_px[i] > least_px:
            depth_m[i] = near


@compile_fast
def project(
    first: int, last: int, seen: Longs, mesh: Longs, start: Longs, forms: Forms,
    things: Instances, view: PinholeView, lamp: Lamp, point: Singles, box: Singles,
) -> None:  # fmt: skip
    """Project and light the vertices of `seen[first:last]` into `point` (V, 6).

    `box` (N, 5) receives the smallest and largest column, row, and the nearest depth.
    Leaves are lit from both sides: the far side of a lit leaf glows with part of the light.
    """
    axes = np.empty((5, 4))
    vertex, near_m, focal_px, cx_px, cy_px = (
        forms.vertex, view.near_m, view.focal_px, view.cx_px, view.cy_px,
    )  # fmt: skip
    for k in range(first, last):
        i = seen[k]
        _aim(i, things, view, lamp, axes)
        solid = things.solid[i] > 0
        through = 0.0 if solid else 0.5
        sunlight = lamp.diffuse * things.sun[i]
        ambient = lamp.ambient * (0.8 + 0.2 * things.sun[i])
        x_min, x_max, y_min, y_max = FARTHEST, -FARTHEST, FARTHEST, -FARTHEST
        z_min, z_max = FARTHEST, -FARTHEST
        to = start[k]
        origin = forms.first_vertex[mesh[k]]
        for j in range(origin, origin + forms.vertices[mesh[k]]):
            x, y, z = float(vertex[j, 0]), float(vertex[j, 1]), float(vertex[j, 2])
            depth = _apply_axis(axes, 2, x, y, z)
            column, row = _apply_axis(axes, 0, x, y, z), _apply_axis(axes, 1, x, y, z)
            lit = vertex[j, 3] * axes[3, 0] + vertex[j, 4] * axes[3, 1] + vertex[j, 5] * axes[3, 2]
            towards = vertex[j, 3] * (axes[4, 0] - x) + vertex[j, 4] * (axes[4, 1] - y)
            towards += vertex[j, 5] * (axes[4, 2] - z)
            light = abs(lit) if lit * towards > 0.0 else through * abs(lit)
            upward = vertex[j, 5] if solid else abs(vertex[j, 5])
            shade = (ambient * (0.75 + 0.25 * upward) + sunlight * light) * vertex[j, 8]
            point[to, U], point[to, V], point[to, SHADE] = vertex[j, 6], vertex[j, 7], shade
            z_min, z_max = min(z_min, depth), max(z_max, depth)
            if depth >= near_m:
                column = cx_px + focal_px * column / depth
                row = cy_px + focal_px * row / depth
                x_min, x_max = min(x_min, column), max(x_max, column)
                y_min, y_max = min(y_min, row), max(y_max, row)
            point[to, COLUMN], point[to, ROW], point[to, DEPTH] = column, row, depth
            to += 1
        if z_min < near_m <= z_max:  # cut by the near plane: may reach anywhere
            x_min, x_max, y_min, y_max = -FARTHEST, FARTHEST, -FARTHEST, FARTHEST
        box[k, 0], box[k, 1], box[k, 2], box[k, 3] = x_min, x_max, y_min, y_max
        box[k, 4] = max(z_min, near_m)


@inline_fast
def _apply_axis(axes: Doubles, row: int, x: float, y: float, z: float) -> float:
    return float(axes[row, 0] * x + axes[row, 1] * y + axes[row, 2] * z + axes[row, 3])


@compile_fast
def _aim(i: int, things: Instances, view: PinholeView, lamp: Lamp, axes: Doubles) -> None:
    """Write camera, sun and eye in the axes of a thing's mesh into `axes` (5, 4).

    Rows 0 to 2 are the camera's axes with its place, 3 the sun, 4 the eye: vertices and normals
    then need no turning.
    """
    turn, scale = things.rotation[i], float(things.scale[i])
    away_x = things.position[i, 0] - view.eye[0]
    away_y = things.position[i, 1] - view.eye[1]
    away_z = things.position[i, 2] - view.eye[2]
    to_camera, sun = view.camera_from_map, lamp.to_sun
    for k in range(3):
        for row in range(3):
            axes[row, k] = scale * _turn_axis(
                to_camera[row, 0], to_camera[row, 1], to_camera[row, 2], turn, k
            )
        axes[3, k] = _turn_axis(sun[0], sun[1], sun[2], turn, k)
        axes[4, k] = -_turn_axis(away_x, away_y, away_z, turn, k) / scale
        axes[k, 3] = to_camera[k, 0] * away_x + to_camera[k, 1] * away_y + to_camera[k, 2] * away_z


@compile_fast
def _turn_axis(x: float, y: float, z: float, turn: Singles, k: int) -> float:
    return float(x * turn[0, k] + y * turn[1, k] + z * turn[2, k])


@compile_fast
def shade_plants(
    first: int, last: int, seen: Longs, mesh: Longs, start: Longs, forms: Forms,
    things: Instances, lamp: Lamp, rover: RobotShade, point: Singles,
) -> None:  # fmt: skip
    """Darken the projected vertices of `seen[first:last]` that are in the robot's shadow.

    They keep the light of the sky; solid things are not shaded. Changes `point` (V, 6).
    """
    vertex = forms.vertex
    for k in range(first, last):
        i = seen[k]
        if things.solid[i] > 0 or not _is_near_shadow(things, forms, i, rover):
            continue
        turn, scale, origin = things.rotation[i], things.scale[i], forms.first_vertex[mesh[k]]
        count = forms.vertices[mesh[k]]
        place, past = np.empty((3, count)), np.empty(count, np.float32)
        for j in range(count):
            p = vertex[origin + j]
            for axis in range(3):
                away = turn[axis, 0] * p[0] + turn[axis, 1] * p[1] + turn[axis, 2] * p[2]
                place[axis, j] = scale * away + things.position[i, axis]
        shade_points(count, place[0], place[1], place[2], rover, past)
        for j in range(count):
            if past[j] < 1.0:
                lit, p = point[start[k] + j, SHADE], vertex[origin + j]
                sky = min(lit, 0.8 * lamp.ambient * (0.75 + 0.25 * abs(p[5])) * p[8])
                point[start[k] + j, SHADE] = sky + (lit - sky) * past[j]


@compile_fast
def _is_near_shadow(things: Instances, forms: Forms, i: int, rover: RobotShade) -> bool:
    """Return whether a thing may be where the robot's shadow is."""
    reach = forms.radius[things.form[i]] * things.scale[i]
    reach *= 1.0 + abs(rover.slope[0]) + abs(rover.slope[1])
    rise = things.position[i, 2] - rover.level_m
    x = things.position[i, 0] + rover.slope[0] * rise - rover.x_m
    y = things.position[i, 1] + rover.slope[1] * rise - rover.y_m
    rows, columns = rover.shade.shape
    if x < -reach or y < -reach:
        return False
    return bool(x < columns * rover.step_m + reach and y < rows * rover.step_m + reach)
