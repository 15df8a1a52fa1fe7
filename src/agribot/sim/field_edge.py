"""How far the robot's rectangle, implement included, is out of a field with holes.

Its outline is looked at in steps, and every corner of the field that reaches into it, such as those
of a post in the middle of it.
"""

from __future__ import annotations

import math

import numpy as np

from agribot.core.field_bounds import FieldBounds
from agribot.core.messages import FloatArray

STEP_M = 0.1  # distance of the sampled places of the rectangle's outline


class FieldEdge:
    """Measures against the rings of a field; far from every edge it costs next to nothing."""

    def __init__(self, bounds: FieldBounds) -> None:
        self._bounds = bounds
        rings = [np.asarray(ring, dtype=float) for ring in bounds.rings_map_m]
        self._start = np.concatenate(rings)
        self._along = np.concatenate([np.roll(ring, -1, axis=0) - ring for ring in rings])
        self._outline = _outline_m(bounds)
        self._reach_m = float(np.hypot(*self._outline.T).max())
        self._clear_at, self._clear_m = (math.inf, math.inf), 0.0

    def measure_outside_m(self, x_m: float, y_m: float, yaw_rad: float) -> float:
        """Measure how far the farthest place of the rectangle is outside; 0 where all is inside."""
        if math.dist((x_m, y_m), self._clear_at) < self._clear_m:
            return 0.0
        middle_m = self._measure_m(np.array([[x_m, y_m]]))[0]
        self._clear_at, self._clear_m = (x_m, y_m), -middle_m - self._reach_m
        if self._clear_m > 0.0:
            return 0.0
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        map_from_body = np.array([[cos, sin], [-sin, cos]])  # rotation of rows of places
        places = self._outline @ map_from_body + (x_m, y_m)
        corners = (self._start - (x_m, y_m)) @ map_from_body.T
        return max(float(self._measure_m(places).max()), self._measure_depth_m(corners), 0.0)

    def _measure_depth_m(self, corners: FloatArray) -> float:
        """Measure how deep corners of the field (N, 2), in the body frame, reach into the body."""
        bounds = self._bounds
        x, y = corners.T
        ahead_m = np.minimum(bounds.front_m - x, x + bounds.rear_m)
        return float(np.minimum(ahead_m, bounds.half_width_m - np.abs(y)).max())

    def _measure_m(self, places: FloatArray) -> FloatArray:
        """Measure from places (N, 2) to the nearest edge, (N,): above 0 outside, below inside."""
        away = places[:, None] - self._start
        along = self._along
        length2 = np.maximum((along * along).sum(1), 1e-12)
        share = np.clip((away * along).sum(2) / length2, 0.0, 1.0)
        nearest_m = np.sqrt(((away - share[..., None] * along) ** 2).sum(2).min(1))
        crosses = (away[..., 1] < 0.0) != (away[..., 1] < along[:, 1])
        rise = np.where(crosses, along[:, 1], 1.0)
        is_left = crosses & (away[..., 0] < away[..., 1] * along[:, 0] / rise)
        is_inside = np.count_nonzero(is_left, axis=1) % 2 == 1
        measured: FloatArray = np.where(is_inside, -nearest_m, nearest_m)
        return measured


def _outline_m(bounds: FieldBounds) -> FloatArray:
    """Return places on the outline of the rectangle, (N, 2) in the body frame, corners first."""
    x, y = (-bounds.rear_m, bounds.front_m), (-bounds.half_width_m, bounds.half_width_m)
    lines = [np.linspace(*ends, math.ceil((ends[1] - ends[0]) / STEP_M) + 1) for ends in (x, y)]
    sides = [np.column_stack([lines[0], np.full(len(lines[0]), end)]) for end in y]
    ends = [np.column_stack([np.full(len(lines[1]), end), lines[1]]) for end in x]
    return np.concatenate([*sides, *ends])
