"""The point tool in the simulator: a spot kills the weed that it stays on, and hurts crop at once.

A head's aim has a limited speed, and after every shot the head is dark until it has recharged,
whatever the command.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from agribot.core.errors import PlatformError
from agribot.core.implement.kind import Pull
from agribot.core.implement.point import PointSpec, read_aim
from agribot.core.messages import FloatArray, ImplementCommand, PlantClass
from agribot.core.world import WorldSpec
from agribot.sim.flora.crown import HEART_M
from agribot.sim.footprints import Footprints, list_places_m, project_to_ground
from agribot.sim.implements.sections import SAME_TIME_S, DelayedSections


class PointEffect:
    """Heads on the way from aim to aim, and the heat in each plant below them."""

    def __init__(self, spec: PointSpec, world: WorldSpec, base_height_m: float) -> None:
        self.worked_m2 = 0.0
        self._spec = spec
        self._sections = DelayedSections(spec)
        self._pending: deque[tuple[float, ImplementCommand]] = deque()
        self._aims_m = np.array([(0.0, y_m) for y_m in spec.section_y_body_m()])
        self._wanted_m = self._aims_m.copy()
        self._ready_s = np.full(spec.section_count, -math.inf)
        self._is_lit = np.zeros(spec.section_count, dtype=bool)
        self._feet = Footprints(np.zeros((0, 2)), 0.0, 0.0, base_height_m)
        plants = world.plants
        self._xy_m = list_places_m(plants)
        self._is_crop = np.array([p.plant == PlantClass.CROP for p in plants], dtype=bool)
        self._reach_m = spec.spot_radius_m + np.where(self._is_crop, HEART_M, 0.0)
        self._heat_s = np.zeros(len(plants))
        self._treated: dict[int, float] = {}

    def command(self, t_s: float, command: ImplementCommand) -> None:
        self._sections.command(t_s, command.sections_on)
        half_m = self._spec.section_width_m / 2.0 + 1e-9
        for head, y_m in enumerate(self._spec.section_y_body_m()):
            aim = read_aim(command, head)
            if aim and (abs(aim.x_m) > self._spec.reach_m + 1e-9 or abs(aim.y_m - y_m) > half_m):
                raise PlatformError(
                    f"head {head + 1}: aim {aim.x_m:.3f} m ahead and {aim.y_m:.3f} m to the "
                    f"left; it reaches {self._spec.reach_m:g} m, and {half_m:.3g} m around {y_m:g}"
                )
        if command.setpoints:
            self._pending.append((t_s + self._spec.latency_s, command))

    def update(self, t_s: float, before: FloatArray, after: FloatArray, dt_s: float) -> None:
        """Move the aims over the tick that ends at `t_s`, then heat what is below them."""
        start_s = t_s - dt_s
        self._sections.advance(start_s)
        while self._pending and self._pending[0][0] <= start_s + SAME_TIME_S:
            _, command = self._pending.popleft()
            for head in range(self._spec.section_count):
                aim = read_aim(command, head)
                if aim is not None:
                    self._wanted_m[head] = aim
        self._move(dt_s)
        for head in range(self._spec.section_count):
            is_lit = (
                bool(self._sections.is_on[head]) and start_s >= self._ready_s[head] - SAME_TIME_S
            )
            if is_lit:
                self.worked_m2 += 0.0 if self._is_lit[head] else self._spot_m2
                self._shine(head, t_s, (before, after), dt_s)
            elif self._is_lit[head]:
                self._ready_s[head] = start_s + self._spec.recharge_s
            self._is_lit[head] = is_lit

    def pull(self) -> Pull | None:
        return None

    @property
    def treated(self) -> dict[int, float]:
        return self._treated

    @property
    def _spot_m2(self) -> float:
        return math.pi * self._spec.spot_radius_m**2

    def _move(self, dt_s: float) -> None:
        gap_m = self._wanted_m - self._aims_m
        length_m = np.hypot(gap_m[:, 0], gap_m[:, 1])
        ratio = np.minimum(1.0, self._spec.aim_speed_mps * dt_s / np.maximum(length_m, 1e-12))
        self._aims_m += ratio[:, None] * gap_m

    def _shine(
        self, head: int, t_s: float, rows: tuple[FloatArray, FloatArray], dt_s: float
    ) -> None:
        """Heat what is below the aim, where it is in the middle of the tick between two rows."""
        if not len(self._xy_m):
            return
        ahead_m, left_m = self._aims_m[head].tolist()
        x_body_m = self._spec.x_body_m + ahead_m
        ends_m = [project_to_ground(row, x_body_m, left_m, self._feet) for row in rows]
        spot_m = np.mean(ends_m, axis=0)
        gap_m = np.hypot(*(self._xy_m - spot_m).T)
        is_hot = gap_m <= self._reach_m
        self._heat_s[is_hot] += dt_s
        needed_s = np.where(self._is_crop, 0.0, self._spec.dwell_s - SAME_TIME_S)
        for index in np.flatnonzero(is_hot & (self._heat_s >= needed_s)).tolist():
            self._treated.setdefault(index, t_s)
