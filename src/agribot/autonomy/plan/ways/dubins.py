"""Shortest forward paths of bounded curvature between two poses.

Source: Dubins 1957; closed forms after Shkel and Lumelsky 2001, "Classification of the Dubins
set", Robotics and Autonomous Systems 34.
"""

from __future__ import annotations

import math

from agribot.autonomy.plan.ways.curves import Segment, length_m
from agribot.core.pose import Pose2

Solution = tuple[float, float, float]  # arc, middle piece, arc; in units of the radius
_FULL_TURN_SLACK_RAD = 1e-9


def find_shortest(start: Pose2, end: Pose2, radius_m: float) -> tuple[Segment, ...]:
    return list_words(start, end, radius_m)[0]


def list_words(start: Pose2, end: Pose2, radius_m: float) -> list[tuple[Segment, ...]]:
    """List every feasible word (LSL, RSR, LSR, RSL, RLR, LRL), shortest first; never empty."""
    dx, dy = (end.x_m - start.x_m) / radius_m, (end.y_m - start.y_m) / radius_m
    bearing = math.atan2(dy, dx)
    d = math.hypot(dx, dy)
    alpha, beta = _wrap_turn_rad(start.yaw_rad - bearing), _wrap_turn_rad(end.yaw_rad - bearing)
    words = []
    for name, solve in _WORDS.items():
        solution = solve(d, alpha, beta)
        if solution is not None:
            words.append(_make_segments(name, solution, radius_m))
    return sorted(words, key=length_m)


def _make_segments(name: str, solution: Solution, radius_m: float) -> tuple[Segment, ...]:
    sign = {"L": 1.0, "S": 0.0, "R": -1.0}
    return tuple(
        Segment(piece * radius_m, sign[letter] / radius_m)
        for letter, piece in zip(name, solution, strict=True)
    )


def _wrap_turn_rad(angle_rad: float) -> float:
    """Wrap an angle to [0, 2 pi); rounding below zero is zero, not a full turn."""
    angle_rad %= math.tau
    return 0.0 if math.tau - angle_rad < _FULL_TURN_SLACK_RAD else angle_rad


def _take_root(square: float) -> float | None:
    """Square root that forgives rounding; None where the word does not exist."""
    return math.sqrt(max(square, 0.0)) if square > -1e-9 else None


def _lsl(d: float, alpha: float, beta: float) -> Solution | None:
    p = _take_root(
        2 + d * d - 2 * math.cos(alpha - beta) + 2 * d * (math.sin(alpha) - math.sin(beta))
    )
    if p is None:
        return None
    if p < 1e-9:
        return _wrap_turn_rad(beta - alpha), 0.0, 0.0
    theta = math.atan2(math.cos(beta) - math.cos(alpha), d + math.sin(alpha) - math.sin(beta))
    return _wrap_turn_rad(theta - alpha), p, _wrap_turn_rad(beta - theta)


def _rsr(d: float, alpha: float, beta: float) -> Solution | None:
    return _lsl(d, -alpha, -beta)


def _lsr(d: float, alpha: float, beta: float) -> Solution | None:
    p = _take_root(
        -2 + d * d + 2 * math.cos(alpha - beta) + 2 * d * (math.sin(alpha) + math.sin(beta))
    )
    if p is None:
        return None
    theta = math.atan2(-math.cos(alpha) - math.cos(beta), d + math.sin(alpha) + math.sin(beta))
    theta -= math.atan2(-2.0, p)
    return _wrap_turn_rad(theta - alpha), p, _wrap_turn_rad(theta - beta)


def _rsl(d: float, alpha: float, beta: float) -> Solution | None:
    return _lsr(d, -alpha, -beta)


def _lrl(d: float, alpha: float, beta: float) -> Solution | None:
    cosine = (
        6 - d * d + 2 * math.cos(alpha - beta) - 2 * d * (math.sin(alpha) - math.sin(beta))
    ) / 8
    if abs(cosine) > 1.0:
        return None
    p = _wrap_turn_rad(math.tau - math.acos(cosine))
    theta = math.atan2(math.cos(alpha) - math.cos(beta), d + math.sin(alpha) - math.sin(beta))
    t = _wrap_turn_rad(-alpha - theta + p / 2)
    return t, p, _wrap_turn_rad(beta - alpha - t + p)


def _rlr(d: float, alpha: float, beta: float) -> Solution | None:
    return _lrl(d, -alpha, -beta)


_WORDS = {"LSL": _lsl, "RSR": _rsr, "LSR": _lsr, "RSL": _rsl, "LRL": _lrl, "RLR": _rlr}
