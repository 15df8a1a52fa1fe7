"""Pointing: which weed each head is aimed at, and when it shoots.

A head takes the weed that leaves its reach first and stays on it for the dwell time, while the
robot moves on: the aim of every tick is where the weed will be when the command takes effect.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from agribot.autonomy.implements.beside_rows import NO_ROWS, find_rows_around
from agribot.autonomy.implements.crop_guard import (
    find_keep_off_m,
    find_most_keep_off_m,
    find_pose_margin_m,
)
from agribot.autonomy.implements.leaves import spare_leaves
from agribot.autonomy.implements.tool_frame import (
    Placed,
    ToolPose,
    find_near,
    move_on,
)
from agribot.core.arithmetic import clamp
from agribot.core.config import TreatmentConfig
from agribot.core.implement.kind import ReportLine
from agribot.core.implement.plants import PlantMap
from agribot.core.implement.point import Aim, PointSpec, name_aim
from agribot.core.messages import Estimate, ImplementCommand, PlantClass

LONGEST_TICK_S = 0.1  # longest tick that is credited as time on a weed


@dataclass(slots=True)
class _Head:
    """State of a head: its weed, the time on it, its aim, and the time when it can shoot."""

    aim: Aim
    weed: int | None = None
    shot_s: float = 0.0
    ready_s: float = -math.inf
    is_lit: bool = False


class Pointer:
    """Aims heads at weeds."""

    def __init__(self, spec: PointSpec, config: TreatmentConfig) -> None:
        self._spec, self._config = spec, config
        self._y_body_m = spec.section_y_body_m()
        self._heads = [_Head(Aim(0.0, y_m)) for y_m in self._y_body_m]
        self._last_s: float | None = None
        self._weeds_treated = self._shots = 0

    def step(self, estimate: Estimate, plants: PlantMap, *, may_work: bool) -> ImplementCommand:
        spec = self._spec
        last_s, self._last_s = self._last_s, estimate.t_s
        tick_s = 0.0 if last_s is None else clamp(estimate.t_s - last_s, 0.0, LONGEST_TICK_S)
        margin_m = find_most_keep_off_m(self._config) + spec.spot_radius_m
        ahead_m = spec.reach_m + abs(estimate.v_mps) * spec.latency_s + margin_m
        half_m = spec.width_m / 2.0 + margin_m
        near = find_near(estimate, plants, spec.x_body_m, ahead_m, half_m) if estimate.ok else []
        # A command holds for a tick: aimed for the middle of it, the spot errs least.
        then = move_on(near, estimate, spec.x_body_m, spec.latency_s + tick_s / 2.0)
        free = self._find_free(then, estimate, plants, may_work=may_work)
        aims: dict[str, float] = {}
        is_on = []
        for index, head in enumerate(self._heads):
            weed = self._follow(index, free, estimate, tick_s, plants)
            head.is_lit = weed is not None and estimate.t_s >= head.ready_s
            is_on.append(head.is_lit)
            if weed is not None:
                head.aim = Aim(weed.x_m, weed.y_m)
                aims |= dict(zip(name_aim(index), head.aim, strict=True))
        return ImplementCommand(sections_on=tuple(is_on), setpoints=aims)

    def report(self) -> tuple[ReportLine, ...]:
        return (
            ReportLine("plants treated as weeds", self._weeds_treated),
            ReportLine("shots", self._shots),
        )

    def _find_free(
        self, near: list[Placed], estimate: Estimate, plants: PlantMap, *, may_work: bool
    ) -> dict[int, Placed]:
        """Find the weeds, by id, that may be shot at; note why others may not."""
        crops = [p for p in near if p.plant.plant == PlantClass.CROP]
        free: dict[int, Placed] = {}
        for weed in near:
            if weed.plant.plant != PlantClass.WEED or abs(weed.x_m) > self._spec.reach_m:
                continue
            reason = "" if may_work else "tool off"
            if not weed.plant.is_confirmed:
                reason = "seen too late"
            elif weed.plant.treated_s is not None:
                continue
            elif abs(weed.y_m) > self._spec.width_m / 2.0:
                reason = "outside the tool"
            reason = reason or self._find_crop_reason(weed, crops, estimate, plants)
            plants.note_left(weed.plant.id, reason or "tool busy")
            if not reason:
                free[weed.plant.id] = weed
        return free

    def _find_crop_reason(
        self, weed: Placed, crops: list[Placed], estimate: Estimate, plants: PlantMap
    ) -> str:
        """Say which part of a crop forbids the spot; empty where none does."""
        spot_m = self._spec.spot_radius_m
        for crop in crops:
            keep_off_m = find_keep_off_m(crop.plant, estimate, self._config) + spot_m
            if math.hypot(crop.x_m - weed.x_m, crop.y_m - weed.y_m) < keep_off_m:
                return "beside a crop"
        place = ToolPose(weed.plant.x_map_m, weed.plant.y_map_m, estimate.yaw_map_rad)
        half_m = spot_m + find_pose_margin_m(estimate, self._config)
        rule = self._config.leaves
        beside_m = self._config.beside_row_m
        rows = find_rows_around(place, plants, beside_m) if rule == "rows" else NO_ROWS
        (is_bare,) = spare_leaves((True,), (0.0,), place, half_m, half_m, plants, rule, rows)
        return "" if is_bare else "leaf of crop"

    def _follow(
        self,
        index: int,
        free: dict[int, Placed],
        estimate: Estimate,
        tick_s: float,
        plants: PlantMap,
    ) -> Placed | None:
        """Credit a head's shot, and give it its weed: the one before, or the next."""
        head, t_s = self._heads[index], estimate.t_s
        if head.weed is not None and head.is_lit:
            head.shot_s += tick_s
            # A tick late at both ends, as commands meet the ticks of the head.
            if head.weed in free and head.shot_s >= self._spec.dwell_s + 2.0 * tick_s:
                plants.mark_treated(head.weed, t_s)
                self._weeds_treated += 1
                del free[head.weed]
        if head.weed is not None and (head.weed not in free or not self._reaches(index, free)):
            if head.is_lit:
                head.ready_s = t_s + self._spec.recharge_s
            head.weed = None
        if head.weed is None:
            weed = self._choose(index, free, estimate)
            if weed is None:
                return None
            way_s = math.dist(head.aim, (weed.x_m, weed.y_m)) / self._spec.aim_speed_mps
            head.weed, head.shot_s = weed.plant.id, 0.0
            head.ready_s = max(head.ready_s, t_s + way_s)
            self._shots += 1
            plants.note_left(weed.plant.id, "aimed at and not hit")
        return free[head.weed]

    def _reaches(self, index: int, free: dict[int, Placed]) -> bool:
        weed = self._heads[index].weed
        return weed is not None and self._is_below(index, free[weed].y_m)

    def _is_below(self, index: int, y_m: float) -> bool:
        return abs(y_m - self._y_body_m[index]) <= self._spec.section_width_m / 2.0

    def _choose(self, index: int, free: dict[int, Placed], estimate: Estimate) -> Placed | None:
        """Choose the weed below a head that leaves its reach first, of those that it can finish."""
        spec = self._spec
        aim_s = math.hypot(2.0 * spec.reach_m, spec.section_width_m) / spec.aim_speed_mps
        needed_m = abs(estimate.v_mps) * (spec.dwell_s + aim_s + spec.recharge_s)
        taken = {head.weed for head in self._heads}
        way = math.copysign(1.0, estimate.v_mps)  # ground comes from ahead, or from behind
        left = [
            weed
            for id, weed in free.items()
            if id not in taken
            and self._is_below(index, weed.y_m)
            and way * weed.x_m + spec.reach_m >= needed_m
        ]
        return min(left, key=lambda weed: way * weed.x_m, default=None)
