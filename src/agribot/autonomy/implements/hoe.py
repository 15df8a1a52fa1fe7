"""Hoeing: every blade works the ground, but where crop stands or may stand.

A blade at depth uproots all that it passes over, so a hoe gets no command for each weed. Its rule
is the reverse of a sprayer's: down is the normal state in a row, and a blade rises for the crop,
early enough to be out of the soil before it. It stays up over ground that no frame has shown, near
every stem of crop, confirmed or not, and over leaves of crop, except those of a plant that stands
alone and, where `treatment.leaves` allows it, those beside a row.
"""

from __future__ import annotations

import math

from agribot.autonomy.implements.beside_rows import NO_ROWS, find_rows_around
from agribot.autonomy.implements.crop_guard import (
    CROP_STEM_M,
    find_keep_off_m,
    find_most_keep_off_m,
    find_pose_margin_m,
)
from agribot.autonomy.implements.delay import StepMeter
from agribot.autonomy.implements.leaves import spare_leaves
from agribot.autonomy.implements.tool_frame import ToolPose, find_around, find_crops, predict_tool
from agribot.core.config import LeafRule, TreatmentConfig
from agribot.core.errors import ConfigError
from agribot.core.implement.hoe import DEPTH, HoeSpec
from agribot.core.implement.kind import ReportLine
from agribot.core.implement.plants import GroundBox, KnownPlant, PlantMap
from agribot.core.messages import Estimate, ImplementCommand, PlantClass
from agribot.core.pose import Pose2

BLADE_M = 0.03  # length of a blade along the way
HIT_M = BLADE_M / 2.0
# A large plant has a thick stem: an assumption of how thick, by the radius of its leaves, at most.
STEM_RATIO, MOST_STEM_M = 0.3, 0.06
CLEAR_M = 0.02  # height above level ground up to which a blade counts as in the soil


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
        self._down = (False,) * len(self._y_body_m)
        self._why_up = ("tool off",) * len(self._y_body_m)
        self._down_since_s = [math.inf] * len(self._y_body_m)
        self._meter = StepMeter()
        self._weeds_treated = self._lifts = 0
        self._hoed_m2 = self._passed_m2 = 0.0

    def step(self, estimate: Estimate, plants: PlantMap, *, may_work: bool) -> ImplementCommand:
        step_m = self._meter.advance(estimate)
        self._credit(estimate, plants, step_m)
        self._why_up = ("tool off",) * len(self._y_body_m)
        if may_work:
            self._passed_m2 += step_m * self._spec.section_width_m * self._spec.section_count
            self._why_up = self._choose(estimate, plants, step_m)
        down = tuple(not reason for reason in self._why_up)
        self._note(estimate.t_s, down)
        setpoints = {DEPTH: self._depth_m} if any(down) else {}
        return ImplementCommand(sections_on=down, setpoints=setpoints)

    def report(self) -> tuple[ReportLine, ...]:
        return (
            ReportLine("plants treated as weeds", self._weeds_treated),
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
        """Note the weeds that blades pass over: treated by those at depth, left by the others."""
        spec = self._spec
        since_s = estimate.t_s - spec.latency_s - spec.stroke_s
        is_deep = [down_s <= since_s for down_s in self._down_since_s]
        half_m = spec.section_width_m / 2.0
        self._hoed_m2 += step_m * spec.section_width_m * sum(is_deep)
        tool = predict_tool(estimate, spec.x_body_m, 0.0)
        for plant in find_around(plants, tool, self._y_body_m[0] + half_m):
            x_m, y_m = _see_from(tool, plant)
            if plant.plant != PlantClass.WEED or abs(x_m) > max(step_m, HIT_M):
                continue
            over = [i for i, blade_m in enumerate(self._y_body_m) if abs(y_m - blade_m) <= half_m]
            if any(is_deep[index] for index in over):
                self._weeds_treated += plant.treated_s is None and plant.is_confirmed
                plants.mark_treated(plant.id, estimate.t_s)
            elif over:
                plants.note_left(plant.id, self._why_up[over[0]] or "aimed at and not hit")

    def _choose(self, estimate: Estimate, plants: PlantMap, step_m: float) -> tuple[str, ...]:
        """Return for each blade why it must be up, one of REASONS; "" if it may be down.

        A blade may be down if it meets no crop before it is out of the soil when commanded to rise
        in the next tick.
        """
        spec, config = self._spec, self._config
        rise_s = self._find_rise_s()
        half_x_m = (abs(estimate.v_mps) * rise_s + step_m + BLADE_M) / 2.0
        # The tool swings aside in a curve, and on a slope the robot crabs.
        course_rad = estimate.slip_rad + estimate.yaw_rate_radps * (spec.latency_s + rise_s)
        half_y_m = spec.section_width_m / 2.0 + half_x_m * abs(math.sin(course_rad))
        middle = predict_tool(estimate, spec.x_body_m, spec.latency_s + rise_s / 2.0)
        reach_m = half_x_m + self._y_body_m[0] + half_y_m + self._find_most_keep_off_m()
        crops = [
            (*_see_from(middle, plant), self._find_keep_off_m(plant, estimate))
            for plant in find_crops(plants, middle, reach_m)
        ]
        is_off_stems = tuple(
            all(_gap_m(x, y - blade_m, half_x_m, half_y_m) > keep_m for x, y, keep_m in crops)
            for blade_m in self._y_body_m
        )
        pose_m = find_pose_margin_m(estimate, config)
        box_m = half_x_m + pose_m, half_y_m + pose_m
        is_off_leaves = self._spare_leaves(is_off_stems, middle, box_m, plants)
        return tuple(
            "stem of crop" if not off_stems
            else "leaf of crop" if not off_leaves
            else "" if self._is_seen(plants, middle, blade_m, *box_m)
            else "seen too late"
            for blade_m, off_stems, off_leaves in zip(
                self._y_body_m, is_off_stems, is_off_leaves, strict=True
            )
        )  # fmt: skip

    def _find_keep_off_m(self, crop: KnownPlant, estimate: Estimate) -> float:
        """Return a blade's distance from a crop's place: as a nozzle's, and by the thicker stem."""
        stem_m = min(STEM_RATIO * math.sqrt(crop.area_m2 / math.pi), MOST_STEM_M)
        return find_keep_off_m(crop, estimate, self._config) + max(stem_m - CROP_STEM_M, 0.0)

    def _find_most_keep_off_m(self) -> float:
        return find_most_keep_off_m(self._config) + MOST_STEM_M - CROP_STEM_M

    def _spare_leaves(
        self,
        is_on: tuple[bool, ...],
        middle: ToolPose,
        box_m: tuple[float, float],
        plants: PlantMap,
    ) -> tuple[bool, ...]:
        """Lift the blades over leaves, but where the settings allow that no heart can be hit.

        Under leaves in a row a crop may stand whose leaves a network takes for its neighbour's. A
        nozzle opens there for a weed that was seen, a blade would work all of it.
        """
        leaves, rows = self._config.leaves, NO_ROWS
        if leaves == "rows":
            rows = find_rows_around(middle, plants, self._config.beside_row_m)
        rule: LeafRule = "alone" if leaves == "alone" else "none"
        return spare_leaves(is_on, self._y_body_m, middle, *box_m, plants, rule, rows)

    def _find_rise_s(self) -> float:
        """Return the time of a blade from its depth out of the soil."""
        spec = self._spec
        way_m = self._depth_m + min(CLEAR_M, spec.lift_m)
        return spec.stroke_s * way_m / (spec.lift_m + spec.depth_m)

    @staticmethod
    def _is_seen(
        plants: PlantMap, tool: ToolPose, left_m: float, half_x_m: float, half_y_m: float
    ) -> bool:
        x_m = tool.x_map_m - math.sin(tool.yaw_map_rad) * left_m
        y_m = tool.y_map_m + math.cos(tool.yaw_map_rad) * left_m
        box = GroundBox(Pose2(x_m, y_m, tool.yaw_map_rad), half_x_m, half_y_m)
        return plants.crop_ground.is_seen(box)


def _see_from(tool: ToolPose, plant: KnownPlant) -> tuple[float, float]:
    """Place a plant ahead of the tool point and to the left of it, m."""
    dx_m, dy_m = plant.x_map_m - tool.x_map_m, plant.y_map_m - tool.y_map_m
    cos, sin = math.cos(tool.yaw_map_rad), math.sin(tool.yaw_map_rad)
    return cos * dx_m + sin * dy_m, cos * dy_m - sin * dx_m


def _gap_m(x_m: float, y_m: float, half_x_m: float, half_y_m: float) -> float:
    """Distance of a point from a box around the origin."""
    return math.hypot(max(abs(x_m) - half_x_m, 0.0), max(abs(y_m) - half_y_m, 0.0))
