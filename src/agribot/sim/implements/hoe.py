"""The hoe in the simulator: blades that cut what they pass over, and a soil that holds them back.

A crop is cut by a blade in the soil at any depth. A weed is uprooted only by one that is near its
depth and fast enough: the doubtful strip at both ends of a stroke counts against the hoe.
"""

from __future__ import annotations

import math

import numpy as np

from agribot.core.errors import PlatformError
from agribot.core.implement.hoe import DEPTH, HoeSpec
from agribot.core.implement.kind import Pull
from agribot.core.messages import FloatArray, ImplementCommand, PlantClass
from agribot.core.world import WorldSpec
from agribot.sim.attitude import read_rotation
from agribot.sim.implements.sections import DelayedSections, SectionSwath
from agribot.sim.state import ANGULAR, POSITION, VELOCITY

BLADE_M = 0.03  # length of a blade along the way
WORKING_RATIO = 0.8  # share of the commanded depth from which a blade uproots
# Speed from which soil holds back with its whole force; a blade that stands has none.
FULL_DRAUGHT_MPS = 0.1


class HoeEffect:
    """Blades on the way between their place above the ground and their depth in it."""

    def __init__(self, spec: HoeSpec, world: WorldSpec, base_height_m: float) -> None:
        self.worked_m2 = 0.0
        self._spec, self._base_height_m = spec, base_height_m
        self._sections = DelayedSections(spec)
        self._depth_m = np.full(spec.section_count, -spec.lift_m)  # negative: above the ground
        self._wanted_m = spec.depth_m
        self._blade_y_m = np.array(spec.section_y_body_m())
        self._weeds = SectionSwath.over(spec, world, PlantClass.WEED, BLADE_M, base_height_m)
        self._crops = SectionSwath.over(spec, world, PlantClass.CROP, BLADE_M, base_height_m)
        self._pull: Pull | None = None

    def command(self, t_s: float, command: ImplementCommand) -> None:
        depth_m = command.setpoints.get(DEPTH, self._spec.depth_m)
        if not 0.0 < depth_m <= self._spec.depth_m:
            raise PlatformError(
                f"working depth of {depth_m} m; the blades of this hoe reach "
                f"{self._spec.depth_m:g} m"
            )
        self._sections.command(t_s, command.sections_on)
        if command.is_on:
            self._wanted_m = depth_m

    def update(self, t_s: float, before: FloatArray, after: FloatArray, dt_s: float) -> None:
        """Move the blades over the tick that ends at `t_s`, then cut with them."""
        self._sections.advance(t_s - dt_s)
        spec = self._spec
        goal_m = np.where(self._sections.is_on, self._wanted_m, -spec.lift_m)
        step_m = (spec.lift_m + spec.depth_m) / spec.stroke_s * dt_s
        self._depth_m += np.clip(goal_m - self._depth_m, -step_m, step_m)
        is_in_soil = self._depth_m > 0.0
        self._pull = self._hold_back(after, is_in_soil) if is_in_soil.any() else None
        if not is_in_soil.any():
            return
        self._crops.sweep(t_s, before, after, is_in_soil)
        way_m = math.hypot(*(after[POSITION] - before[POSITION])[:2].tolist())
        is_deep = self._depth_m >= WORKING_RATIO * self._wanted_m
        if is_deep.any() and way_m >= spec.min_speed_mps * dt_s:
            self.worked_m2 += self._weeds.sweep(t_s, before, after, is_deep)

    def pull(self) -> Pull | None:
        return self._pull

    @property
    def treated(self) -> dict[int, float]:
        return self._weeds.touched | self._crops.touched

    def _hold_back(self, row: FloatArray, is_in_soil: np.ndarray) -> Pull:
        """Return the draught of all blades in the soil, against the way of their middle."""
        spec = self._spec
        draught_n = (
            spec.draught_npm2 * spec.section_width_m * np.where(is_in_soil, self._depth_m, 0.0)
        )
        total_n = float(draught_n.sum())
        left_m = float(draught_n @ self._blade_y_m) / total_n
        rotation = read_rotation(row)
        arm_m = np.array([spec.x_body_m, left_m, -self._base_height_m])
        velocity_mps = row[VELOCITY] + rotation @ np.cross(row[ANGULAR], arm_m)
        velocity_mps[2] = 0.0
        speed_mps = math.hypot(float(np.linalg.norm(velocity_mps)), FULL_DRAUGHT_MPS)
        x, y, z = (-total_n / speed_mps * velocity_mps).tolist()
        place_m = row[POSITION] + rotation @ arm_m
        return Pull((x, y, z), (float(place_m[0]), float(place_m[1]), float(place_m[2])))
