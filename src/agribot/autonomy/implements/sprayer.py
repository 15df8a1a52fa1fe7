"""Spot spraying: which nozzles are open now, so that the mapped weeds get hit and no crop does.

Crop is spared twice: around the stems in the map, and wherever the last frames showed its leaves,
so that a closed row, whose plants cannot be told apart, is spared as well. Only leaves of a plant
that stands alone in the map may be sprayed, up to its stem: weeds grow at their tips.

A nozzle answers `latency_s` after its command, so a command is about where the boom will be
then. What really flowed is the command of `latency_s` ago: a weed counts as treated only when
that nozzle passed over it.
"""

from __future__ import annotations

import math

from agribot.autonomy.implements.delay import SectionHistory, StepMeter
from agribot.autonomy.implements.leaves import spare_leaves
from agribot.autonomy.implements.tool_frame import Placed, find_near, move_on, predict_tool
from agribot.core.config import TreatmentConfig
from agribot.core.implement.kind import ReportLine
from agribot.core.implement.plants import KnownPlant, PlantMap
from agribot.core.implement.sprayer import SprayerSpec
from agribot.core.messages import Estimate, ImplementCommand, PlantClass

CROP_STEM_M = 0.02  # radius of a young stem
STEM_MARGIN_M = 0.03  # half the spray's length on the ground, and how well a crop is placed
# Off leaves it is half that length and a cell of the ground under crop.
LEAF_MARGIN_M = 0.03
HIT_M = 0.015  # a flat fan wets a line a few centimetres long: so near to its middle is a hit


class SpotSprayer:
    """Opens nozzles over weeds."""

    def __init__(self, spec: SprayerSpec, config: TreatmentConfig) -> None:
        self._spec, self._config = spec, config
        self._y_body_m = spec.section_y_body_m()
        self._closed = (False,) * len(self._y_body_m)
        self._history = SectionHistory(len(self._y_body_m))
        self._meter = StepMeter()
        self._finishing: set[int] = set()
        self.weeds_treated = 0
        self.sprayed_m2 = 0.0
        self.passed_m2 = 0.0  # what a boom that is always open would have sprayed

    def step(self, estimate: Estimate, plants: PlantMap, *, may_work: bool) -> ImplementCommand:
        spec = self._spec
        flowing = self._history.at(estimate.t_s - spec.latency_s)
        step_m = self._meter.advance(estimate)
        opened = self._closed
        if may_work or any(flowing):
            near = self._find_near(estimate, plants)
            self._credit(near, flowing, step_m, plants, estimate.t_s)
            if may_work:
                self.passed_m2 += step_m * spec.section_width_m * spec.section_count
                then = move_on(near, estimate, spec.x_body_m, spec.latency_s)
                opened = self._spare_leaves(self._choose(then, step_m), estimate, step_m, plants)
        self._history.add(estimate.t_s, opened)
        return ImplementCommand(sections_on=opened)

    def report(self) -> tuple[ReportLine, ...]:
        return (
            ReportLine("weeds treated", self.weeds_treated),
            ReportLine("sprayed", self.sprayed_m2, "m2"),
            ReportLine("passed", self.passed_m2, "m2"),
        )

    def _find_near(self, estimate: Estimate, plants: PlantMap) -> list[Placed]:
        """Plants that the boom can reach within its latency; a crop seen once is spared, too."""
        spec, config = self._spec, self._config
        guard_m = 2.0 * (CROP_STEM_M + config.crop_guard_m)
        ahead_m = abs(estimate.v_mps) * spec.latency_s + config.margin_m + guard_m
        half_m = self._y_body_m[0] + spec.section_width_m / 2.0 + guard_m
        return find_near(estimate, plants, spec.x_body_m, ahead_m, half_m)

    def _credit(
        self,
        near: list[Placed],
        flowing: tuple[bool, ...],
        step_m: float,
        plants: PlantMap,
        t_s: float,
    ) -> None:
        """Note what the open nozzles pass over."""
        open_y_m = [y for y, is_open in zip(self._y_body_m, flowing, strict=True) if is_open]
        if not open_y_m:
            return
        width_m = self._spec.section_width_m
        self.sprayed_m2 += step_m * width_m * len(open_y_m)
        hit_m = max(step_m, HIT_M)
        for plant, x_m, y_m in near:
            if abs(x_m) > hit_m or plant.plant != PlantClass.WEED:
                continue
            if any(abs(y_m - nozzle_m) <= width_m / 2.0 for nozzle_m in open_y_m):
                if plant.treated_s is None:
                    self.weeds_treated += 1
                    self._finishing.add(plant.id)
                plants.mark_treated(plant.id, t_s)

    def _choose(self, near: list[Placed], step_m: float) -> tuple[bool, ...]:
        """Find the nozzles whose footprint covers a weed to treat and keeps off every crop."""
        half_m = self._spec.section_width_m / 2.0
        window_m = self._config.margin_m + step_m
        targets = [p for p in near if abs(p.x_m) <= window_m and self._is_target(p.plant)]
        self._finishing.intersection_update({target.plant.id for target in targets})
        if not targets:
            return self._closed
        crops = [(x, y) for plant, x, y in near if plant.plant == PlantClass.CROP]
        is_open = list(self._closed)
        for weed, x_m, y_m in targets:
            spare_m = self._spare_m(x_m, y_m, crops)
            if spare_m is None:
                continue
            reach_m = half_m + min(self._config.margin_m, weed.std_m)
            for index, nozzle_m in enumerate(self._y_body_m):
                if abs(y_m - nozzle_m) <= reach_m and not any(
                    math.hypot(cx, max(abs(cy - nozzle_m) - half_m, 0.0)) < spare_m
                    for cx, cy in crops
                ):
                    is_open[index] = True
        return tuple(is_open)

    def _spare_leaves(
        self, is_open: tuple[bool, ...], estimate: Estimate, step_m: float, plants: PlantMap
    ) -> tuple[bool, ...]:
        spec = self._spec
        pose_m = min(estimate.pos_std_m, self._config.margin_m)
        return spare_leaves(
            is_open,
            self._y_body_m,
            predict_tool(estimate, spec.x_body_m, spec.latency_s),
            LEAF_MARGIN_M + step_m + pose_m,
            spec.section_width_m / 2.0 + pose_m,
            plants,
        )

    def _is_target(self, plant: KnownPlant) -> bool:
        return (
            plant.is_confirmed
            and plant.plant == PlantClass.WEED
            and (plant.treated_s is None or plant.id in self._finishing)
        )

    def _spare_m(self, x_m: float, y_m: float, crops: list[tuple[float, float]]) -> float | None:
        """How far the spray for a weed here must stay from crops; None: leave the weed alone.

        A weed inside the guard ring of a crop may be one of its leaves. One clearly outside it,
        at twice the distance, may be sprayed up to the stem.
        """
        guard_m = CROP_STEM_M + self._config.crop_guard_m
        gap_m = min((math.hypot(cx - x_m, cy - y_m) for cx, cy in crops), default=math.inf)
        if gap_m < guard_m:
            return None
        return guard_m if gap_m < 2.0 * guard_m else CROP_STEM_M + STEM_MARGIN_M
