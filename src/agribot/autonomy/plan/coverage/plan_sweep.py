"""The ground that a robot passes over along a broken line: boxes, wheel traces, bends."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from agribot.autonomy.plan.coverage.area import Leg
from agribot.autonomy.plan.ways.footprint import Footprint
from agribot.core.messages import FloatArray

TURN_STEP_RAD = math.radians(2.0)
BEND_REACH_M = 0.06
SLIGHT_RAD = 0.2  # a bend of a sampled arc, on which the tool moves along an arc too


def sweep_footprint(
    xy: FloatArray, shape: Footprint, before: FloatArray | None, after: FloatArray | None
) -> FloatArray:
    """Sweep boxes (N, 4, 2) along a line (M, 2): one per piece, and per two degrees of turns.

    `before` and `after` are the neighbouring lines; towards their courses the robot turns in
    place at the ends.
    """
    starts, ends = xy[:-1], xy[1:]
    yaw = _list_courses_rad(xy)
    straight = _make_boxes(starts, yaw, shape, np.hypot(*(ends - starts).T))
    boxes = [straight]
    for place, old, new in _list_turns(xy, yaw, before, after):
        turned = _step_turn_rad(old, new)
        boxes.append(_make_boxes(np.broadcast_to(place, (len(turned), 2)), turned, shape))
    return np.concatenate(boxes)


def orient_line(
    legs: tuple[Leg, ...], number: int
) -> tuple[FloatArray, FloatArray | None, FloatArray | None]:
    """Turn a leg's line (N, 2) as the robot looks along it, with the lines before and behind it.

    Those are two points each, (2, 2), along which the robot looks there; None at the ends.
    Backwards it sweeps what it would sweep forwards from the other end.
    """
    leg = legs[number]
    before = _find_heading_line(legs[number - 1], -1) if number else None
    after = _find_heading_line(legs[number + 1], 0) if number + 1 < len(legs) else None
    if leg.is_reverse:
        return leg.xy_map_m[::-1], after, before
    return leg.xy_map_m, before, after


def _find_heading_line(leg: Leg, end: int) -> FloatArray:
    """Two points along which the robot looks at the first (0) or last (-1) point of a leg."""
    xy = leg.xy_map_m[-2:] if end else leg.xy_map_m[:2]
    return xy[::-1] if leg.is_reverse else xy


def trace_wheels(
    xy: FloatArray, shape: Footprint, before: FloatArray | None, after: FloatArray | None
) -> FloatArray:
    """Trace the wheel centres along a line (M, 2) and through its turns, as pieces (N, 2, 2)."""
    wheels = np.array(shape.wheel_xy_body_m)
    yaw = _list_courses_rad(xy)
    rotation = _make_rotations(yaw)
    offset = np.einsum("nij,wj->nwi", rotation, wheels)
    straight = np.stack([xy[:-1, None] + offset, xy[1:, None] + offset], axis=2)
    traces = [straight.reshape(-1, 2, 2)]
    for place, old, new in _list_turns(xy, yaw, before, after):
        turned = _step_turn_rad(old, new)
        spots = place + np.einsum("nij,wj->nwi", _make_rotations(turned), wheels)
        traces.append(np.stack([spots[:-1], spots[1:]], axis=2).reshape(-1, 2, 2))
    return np.concatenate(traces)


def trace_tool(xy: FloatArray, tool_x_m: float) -> FloatArray:
    """Trace a point of the body ahead of its origin along a line (M, 2); (N, 2) with swings.

    At slight bends it is one point, where the robot looks along the tangent; at others it swings
    from one course to the next.
    """
    if tool_x_m == 0.0:
        return xy
    yaw = _list_courses_rad(xy)
    half_rad = np.angle(np.exp(1j * np.diff(yaw))) / 2.0
    is_slight = np.abs(half_rad) <= SLIGHT_RAD / 2.0
    before, after = yaw.copy(), yaw.copy()  # at the beginning and the end of each piece
    after[:-1] += np.where(is_slight, half_rad, 0.0)
    before[1:] = np.where(is_slight, after[:-1], yaw[1:])
    first = xy[:-1] + tool_x_m * np.stack([np.cos(before), np.sin(before)], axis=-1)
    last = xy[1:] + tool_x_m * np.stack([np.cos(after), np.sin(after)], axis=-1)
    swings = np.concatenate([[True], ~is_slight])
    kept = np.stack([swings, np.ones(len(yaw), dtype=bool)], axis=1)
    return np.asarray(np.stack([first, last], axis=1)[kept])


def measure_bends_radpm(xy: FloatArray) -> FloatArray:
    """Measure the curvature at the inner points of a line (N, 2): (N - 2,), rad/m.

    Of a long piece only `BEND_REACH_M` counts: there a drive takes the bend.
    """
    turned = np.abs(np.angle(np.exp(1j * np.diff(_list_courses_rad(xy)))))
    reach_m = np.clip(np.hypot(*np.diff(xy, axis=0).T), 1e-6, BEND_REACH_M)
    return np.asarray(2.0 * turned / (reach_m[:-1] + reach_m[1:]))


def _list_turns(
    xy: FloatArray, yaw: FloatArray, before: FloatArray | None, after: FloatArray | None
) -> Iterator[tuple[FloatArray, float, float]]:
    """List turns in place, with the courses before and after."""
    courses = [*([] if before is None else [_list_courses_rad(before)[-1]]), *yaw]
    courses += [] if after is None else [_list_courses_rad(after)[0]]
    places = xy if before is not None else xy[1:]
    for place, old, new in zip(places, courses, courses[1:], strict=False):
        yield place, float(old), float(new)


def _step_turn_rad(old_rad: float, new_rad: float) -> FloatArray:
    """Courses from old to new, the shorter way round, both included."""
    turn = math.remainder(new_rad - old_rad, math.tau)
    count = max(1, math.ceil(abs(turn) / TURN_STEP_RAD))
    return old_rad + turn * np.linspace(0.0, 1.0, count + 1)


def _list_courses_rad(xy: FloatArray) -> FloatArray:
    step = np.diff(xy, axis=0)
    return np.asarray(np.arctan2(step[:, 1], step[:, 0]))


def _make_rotations(yaw: FloatArray) -> FloatArray:
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)


def _make_boxes(
    places: FloatArray, yaw: FloatArray, shape: Footprint, driven_m: FloatArray | None = None
) -> FloatArray:
    front = shape.front_m + (np.zeros(len(yaw)) if driven_m is None else driven_m)
    rear = np.full(len(yaw), -shape.rear_m)
    half = np.full(len(yaw), shape.half_width_m)
    corners = np.stack(
        [np.stack([front, half], -1), np.stack([rear, half], -1),
         np.stack([rear, -half], -1), np.stack([front, -half], -1)], axis=1,
    )  # fmt: skip
    return np.asarray(places[:, None, :] + np.einsum("nij,nkj->nki", _make_rotations(yaw), corners))
