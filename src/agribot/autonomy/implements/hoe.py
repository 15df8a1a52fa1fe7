"""Hoeing: every blade works the ground, but where crop stands or may stand.

A hoe is not told weed by weed: what a blade passes over at depth is uprooted. So its rule is the
other way round from a sprayer's: down is the normal state in a row, and a blade comes up for the
crop. It comes up early enough: until the end of its stroke it counts as in the soil. It stays up
over ground that no frame has shown, over leaves that are not those of a plant that stands alone in
the map, and within the guard of every crop, also one that is not confirmed yet.
"""

from __future__ import annotations

import math

from agribot.autonomy.implements.crop_guard import CROP_STEM_M
from agribot.autonomy.implements.delay import StepMeter
from agribot.autonomy.implements.leaves import spare_leaves
from agribot.autonomy.implements.tool_frame import ToolPose, predict_tool
from agribot.core.config import TreatmentConfig
from agribot.core.errors import ConfigError
from agribot.core.implement.hoe import DEPTH, HoeSpec
from agribot.core.implement.kind import ReportLine
from agribot.core.implement.plants import KnownPlant, PlantMap
from agribot.core.messages import Estimate, ImplementCommand, PlantClass

BLADE_M = 0.03  # length of a blade along the way
HIT_M = BLADE_M / 2.0


class Hoe:
    """Lowers blades between the crop."""

    def __init__(self, spec: HoeSpec, config: TreatmentConfig) -> None:
        """Take the blades of the robot.

        Raises: ConfigError: they cannot work as deep as the settings want.
        """
        depth_m = spec.depth_m if config.depth_m is None else config.depth_m
        if depth_m > spec.depth_m:
            raise ConfigError(
                f"treatment.depth_m = {depth_m:g} m, but the blades of this robot's hoe reach "
                f"{spec.depth_m:g} m; set it to that or less"
            )
        self._spec, self._config, self._depth_m = spec, config, depth_m
        self._y_body_m = spec.section_y_body_m()
        self._up = (False,) * len(self._y_body_m)
        self._down = self._up
        self._down_since_s = [math.inf] * len(self._y_body_m)
        self._meter = StepMeter()
        self._weeds_treated = self._lifts = 0
        self._hoed_m2 = self._passed_m2 = 0.0

    def step(self, estimate: Estimate, plants: PlantMap, *, may_work: bool) -> ImplementCommand:
        step_m = self._meter.advance(estimate)
        self._credit(estimate, plants, step_m)
        down = self._up
        if may_work:
            self._passed_m2 += step_m * self._spec.section_width_m * self._spec.section_count
            down = self._choose(estimate, plants, step_m)
        self._note(estimate.t_s, down)
        setpoints = {DEPTH: self._depth_m} if any(down) else {}
        return ImplementCommand(sections_on=down, setpoints=setpoints)

    def report(self) -> tuple[ReportLine, ...]:
        return (
            ReportLine("weeds treated", self._weeds_treated),
            ReportLine("hoed", self._hoed_m2, "m2"),
            ReportLine("passed", self._passed_m2, "m2"),
            ReportLine("blade lifts", self._lifts),
        )

    def _note(self, t_s: float, down: tuple[bool, ...]) -> None:
        for index, (was_down, is_down) in enumerate(zip(self._down, down, strict=True)):
            if is_down and not was_down:
                self._down_since_s[index] = t_s
            elif was_down and not is_down:
                self._down_since_s[index] = math.inf
                self._lifts += 1
        self._down = down

    def _credit(self, estimate: Estimate, plants: PlantMap, step_m: float) -> None:
        """Note the weeds that blades at depth pass over."""
        spec = self._spec
        since_s = estimate.t_s - spec.latency_s - spec.stroke_s
        deep_y_m = [
            y_m
            for y_m, told_s in zip(self._y_body_m, self._down_since_s, strict=True)
            if told_s <= since_s
        ]
        if not deep_y_m:
            return
        half_m = spec.section_width_m / 2.0
        self._hoed_m2 += step_m * spec.section_width_m * len(deep_y_m)
        tool = predict_tool(estimate, spec.x_body_m, 0.0)
        reach_m = self._y_body_m[0] + half_m
        for plant in _find_around(plants, tool, reach_m):
            x_m, y_m = _see_from(tool, plant)
            if plant.plant != PlantClass.WEED or abs(x_m) > max(step_m, HIT_M):
                continue
            if any(abs(y_m - blade_m) <= half_m for blade_m in deep_y_m):
                self._weeds_treated += plant.treated_s is None and plant.is_confirmed
                plants.mark_treated(plant.id, estimate.t_s)

    def _choose(self, estimate: Estimate, plants: PlantMap, step_m: float) -> tuple[bool, ...]:
        """Find the blades that may be down until they could be up again, if told next tick."""
        spec = self._spec
        ahead_s = spec.latency_s + spec.stroke_s
        pose_m = min(estimate.pos_std_m, self._config.margin_m)
        half_x_m = (abs(estimate.v_mps) * ahead_s + step_m + BLADE_M) / 2.0 + pose_m
        # The tool swings aside in a curve, and on a slope the robot crabs.
        course_rad = estimate.slip_rad + estimate.yaw_rate_radps * ahead_s
        aside_m = half_x_m * abs(math.sin(course_rad)) + pose_m
        half_y_m = spec.section_width_m / 2.0 + aside_m
        middle = predict_tool(estimate, spec.x_body_m, ahead_s / 2.0)
        crops = [
            (*_see_from(middle, plant), self._guard_m(plant))
            for plant in _find_around(plants, middle, half_x_m + self._y_body_m[0] + half_y_m)
            if plant.plant == PlantClass.CROP
        ]
        down = tuple(
            all(_gap_m(x, y - blade_m, half_x_m, half_y_m) > guard_m for x, y, guard_m in crops)
            and self._is_seen(plants, middle, blade_m, half_x_m, half_y_m)
            for blade_m in self._y_body_m
        )
        return spare_leaves(down, self._y_body_m, middle, half_x_m, half_y_m, plants)

    def _guard_m(self, crop: KnownPlant) -> float:
        """How far from a crop's place a blade stays, as badly as that place is known."""
        return CROP_STEM_M + self._config.crop_guard_m + min(crop.std_m, self._config.margin_m)

    @staticmethod
    def _is_seen(
        plants: PlantMap, tool: ToolPose, left_m: float, half_x_m: float, half_y_m: float
    ) -> bool:
        x_m = tool.x_map_m - math.sin(tool.yaw_map_rad) * left_m
        y_m = tool.y_map_m + math.cos(tool.yaw_map_rad) * left_m
        return plants.crop_ground.is_seen(x_m, y_m, tool.yaw_map_rad, half_x_m, half_y_m)


def _find_around(plants: PlantMap, tool: ToolPose, reach_m: float) -> list[KnownPlant]:
    x_m, y_m, _ = tool
    return list(plants.inside(x_m - reach_m, y_m - reach_m, x_m + reach_m, y_m + reach_m))


def _see_from(tool: ToolPose, plant: KnownPlant) -> tuple[float, float]:
    """Place a plant ahead of the tool point and to the left of it, m."""
    dx_m, dy_m = plant.x_map_m - tool.x_map_m, plant.y_map_m - tool.y_map_m
    cos, sin = math.cos(tool.yaw_map_rad), math.sin(tool.yaw_map_rad)
    return cos * dx_m + sin * dy_m, cos * dy_m - sin * dx_m


def _gap_m(x_m: float, y_m: float, half_x_m: float, half_y_m: float) -> float:
    """Distance of a point from a box around the origin."""
    return math.hypot(max(abs(x_m) - half_x_m, 0.0), max(abs(y_m) - half_y_m, 0.0))
