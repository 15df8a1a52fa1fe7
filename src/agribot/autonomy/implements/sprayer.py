"""Spot spraying: which nozzles are open now to hit the mapped weeds and no crop.

Crop is spared twice: around the stems in the map, including those seen only once, and at every
place where the last frames showed its leaves, so that a row whose plants cannot be separated is
spared as well. By `treatment.leaves`, leaves of plants whose stem is on the map, and leaves beside
a row, may be sprayed.

A nozzle answers `latency_s` after its command, so a command is for where the boom will be then. The
actual flow is that of the command `latency_s` ago: a weed counts as treated only when that nozzle
passed over it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from agribot.autonomy.implements.beside_rows import NO_ROWS, RowsAround, find_rows_around
from agribot.autonomy.implements.crop_guard import (
    CROP_STEM_M,
    SURE_SIGMA,
    find_keep_off_m,
    find_most_keep_off_m,
    find_pose_margin_m,
)
from agribot.autonomy.implements.delay import SectionHistory, StepMeter
from agribot.autonomy.implements.leaves import spare_leaves
from agribot.autonomy.implements.tool_frame import (
    Placed,
    ToolPose,
    find_near,
    find_spread_m,
    move_on,
    predict_tool,
)
from agribot.core.config import TreatmentConfig
from agribot.core.implement.kind import ReportLine
from agribot.core.implement.plants import GroundBox, KnownPlant, PlantMap
from agribot.core.implement.sprayer import SprayerSpec
from agribot.core.messages import Estimate, ImplementCommand, PlantClass
from agribot.core.pose import Pose2

FAN_M = 0.04  # length of the spray on the ground along the way
# Margin around leaves. Off leaves it is half that length and a cell of the ground under crop.
LEAF_MARGIN_M = 0.03
# Error of the boom at the mapped place of a weed, 1 sigma per axis, beyond what differs from look
# to look: wheels and gyro on the way there 15 mm, the error that all looks at its stem share 20 mm.
MET_STD_M = 0.025
SUSPECT_M = 0.01  # largest distance of a suspect weed beside the wetted area
SUSPECT_WIDE_M = 0.09  # scores fall off over this distance around a stem
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
        self.passed_m2 = 0.0  # area that a boom without switching would have sprayed

    def step(self, estimate: Estimate, plants: PlantMap, *, may_work: bool) -> ImplementCommand:
        spec = self._spec
        flowing = self._history.at(estimate.t_s - spec.latency_s)
        step_m = self._meter.advance(estimate)
        is_placed = may_work or estimate.ok or any(flowing)
        near = self._find_near(estimate, plants) if is_placed else []
        self._credit(near, flowing, step_m, plants, estimate.t_s)
        then = move_on(near, estimate, spec.x_body_m, spec.latency_s)
        targets = self._find_targets(then, estimate, step_m, plants)
        opened = self._closed
        if may_work:
            self.passed_m2 += step_m * spec.section_width_m * spec.section_count
            opened = self._open(targets, then, estimate, step_m, plants)
        else:
            for weed in targets:
                plants.note_left(weed.plant.id, "tool off")
        self._history.add(estimate.t_s, opened)
        return ImplementCommand(sections_on=opened)

    def report(self) -> tuple[ReportLine, ...]:
        return (
            ReportLine("plants treated as weeds", self.weeds_treated),
            ReportLine("sprayed", self.sprayed_m2, "m2"),
            ReportLine("passed", self.passed_m2, "m2"),
        )

    def _find_near(self, estimate: Estimate, plants: PlantMap) -> list[Placed]:
        """Plants that the boom can reach within its latency; a crop seen once is spared, too."""
        spec, config = self._spec, self._config
        guard_m = max(2.0 * (CROP_STEM_M + config.crop_guard_m), find_most_keep_off_m(config))
        ahead_m = abs(estimate.v_mps) * spec.latency_s + config.margin_m + FAN_M + guard_m
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

    def _find_targets(
        self, near: list[Placed], estimate: Estimate, step_m: float, plants: PlantMap
    ) -> list[Placed]:
        """Find the weeds to treat that the boom will be over."""
        at_boom = [
            p
            for p in near
            if p.plant.plant == PlantClass.WEED
            and abs(p.x_m) <= self._find_aim_m(p.plant, estimate)[0] + step_m / 2.0
        ]
        for weed in at_boom:
            if not weed.plant.is_confirmed:
                plants.note_left(weed.plant.id, "seen too late")
        targets = [weed for weed in at_boom if self._is_target(weed.plant)]
        self._finishing.intersection_update({target.plant.id for target in targets})
        return targets

    def _open(
        self,
        targets: list[Placed],
        near: list[Placed],
        estimate: Estimate,
        step_m: float,
        plants: PlantMap,
    ) -> tuple[bool, ...]:
        """Open the nozzles that cover a weed and keep off every crop; note why others stay shut."""
        spec, config = self._spec, self._config
        tool = predict_tool(estimate, spec.x_body_m, spec.latency_s)
        scores = self._score_ground(tool, step_m, plants)
        if not targets and not scores:
            return self._closed
        crops = [
            (p.x_m, p.y_m, find_keep_off_m(p.plant, estimate, config))
            for p in near
            if p.plant.plant == PlantClass.CROP
        ]
        needs_rows = bool(scores) or config.leaves == "rows"
        rows = find_rows_around(tool, plants, config.beside_row_m) if needs_rows else NO_ROWS
        box_m = self._find_leaf_box_m(estimate, step_m)
        suspected = self._choose_suspected(scores, rows, crops, box_m, step_m)
        wanted = [self._choose(weed, crops, estimate, step_m) for weed in targets]
        asked = suspected.union(*(indices for indices, _ in wanted))
        is_asked = tuple(index in asked for index in range(len(self._y_body_m)))
        free_rows = rows if config.leaves == "rows" else NO_ROWS
        is_allowed = spare_leaves(
            is_asked, self._y_body_m, tool, *box_m, plants, config.leaves, free_rows
        )
        opened = {index for index in suspected if is_allowed[index]}
        for weed, (indices, reason) in zip(targets, wanted, strict=True):
            is_free = any(is_allowed[index] and self._is_over(weed, index) for index in indices)
            if is_free:
                opened.update(index for index in indices if is_allowed[index])
            aimed = "aimed at and not hit" if is_free else "leaf of crop"
            plants.note_left(weed.plant.id, reason or aimed)
        return tuple(index in opened for index in range(len(self._y_body_m)))

    def _is_over(self, weed: Placed, index: int) -> bool:
        """Whether the place of a weed lies in the strip of a nozzle."""
        return abs(weed.y_m - self._y_body_m[index]) <= self._spec.section_width_m / 2.0

    def _choose(
        self,
        weed: Placed,
        crops: Sequence[tuple[float, float, float]],
        estimate: Estimate,
        step_m: float,
    ) -> tuple[list[int], str]:
        """Find the nozzles for a weed that no stem of crop forbids, or say why no nozzle can."""
        half_m = self._spec.section_width_m / 2.0
        if abs(weed.y_m) > self._y_body_m[0] + half_m:
            return [], "outside the tool"
        guard_m = CROP_STEM_M + self._config.crop_guard_m
        gap_m = min((math.hypot(x - weed.x_m, y - weed.y_m) for x, y, _ in crops), default=math.inf)
        if gap_m < guard_m:
            return [], "beside a crop"
        least_m = guard_m if gap_m < 2.0 * guard_m else 0.0
        reach_m = half_m + self._find_aim_m(weed.plant, estimate)[1]
        chosen = [
            index
            for index, nozzle_m in enumerate(self._y_body_m)
            if abs(weed.y_m - nozzle_m) <= reach_m
            and self._is_off_stems(index, crops, step_m, least_m)
        ]
        is_met = any(self._is_over(weed, index) for index in chosen)
        return (chosen, "") if is_met else ([], "stem of crop")

    def _score_ground(self, tool: ToolPose, step_m: float, plants: PlantMap) -> dict[int, float]:
        """Score the ground under the nozzles, of those that looks suspect of a weed."""
        least = self._config.least_weed_score
        if least >= 1.0:
            return {}
        half_x_m = (FAN_M + step_m) / 2.0 + SUSPECT_M
        half_y_m = self._spec.section_width_m / 2.0 + SUSPECT_M
        box = GroundBox(Pose2(*tool), half_x_m, half_y_m)
        scores = plants.weed_ground.find_scores(box, self._y_body_m)
        return {index: float(score) for index, score in enumerate(scores) if score >= least}

    def _choose_suspected(
        self,
        scores: Mapping[int, float],
        rows: RowsAround,
        crops: Sequence[tuple[float, float, float]],
        box_m: tuple[float, float],
        step_m: float,
    ) -> set[int]:
        """Choose the nozzles whose box of suspect ground lies beside the rows."""
        guard_m = CROP_STEM_M + self._config.crop_guard_m
        free = {
            index
            for index in scores
            if rows.is_beside(self._y_body_m[index], *box_m)
            and self._is_off_stems(index, crops, step_m, guard_m)
        }
        # Beside one that scores more and has to stay shut, it is the weed over there.
        shut = [(self._y_body_m[index], scores[index]) for index in scores if index not in free]
        return {
            index
            for index in free
            if not any(
                score > scores[index] and abs(y_m - self._y_body_m[index]) <= SUSPECT_WIDE_M
                for y_m, score in shut
            )
        }

    def _is_off_stems(
        self,
        index: int,
        crops: Sequence[tuple[float, float, float]],
        step_m: float,
        least_m: float,
    ) -> bool:
        """Whether the spray of a nozzle keeps off every stem of crop, by `least_m` at least."""
        half_x_m, half_y_m = (FAN_M + step_m) / 2.0, self._spec.section_width_m / 2.0
        nozzle_m = self._y_body_m[index]
        return not any(
            math.hypot(max(abs(x) - half_x_m, 0.0), max(abs(y - nozzle_m) - half_y_m, 0.0))
            < max(least_m, keep_off_m)
            for x, y, keep_off_m in crops
        )

    def _find_leaf_box_m(self, estimate: Estimate, step_m: float) -> tuple[float, float]:
        """Return a nozzle's reach for leaves along and across, with the error of the pose."""
        pose_m = find_pose_margin_m(estimate, self._config)
        return LEAF_MARGIN_M + step_m + pose_m, self._spec.section_width_m / 2.0 + pose_m

    def _is_target(self, plant: KnownPlant) -> bool:
        return plant.is_confirmed and (plant.treated_s is None or plant.id in self._finishing)

    def _find_aim_m(self, weed: KnownPlant, estimate: Estimate) -> tuple[float, float]:
        """Return the reach of spray before and beside a weed's place that meets it for sure."""
        along_m, across_m = find_spread_m(weed.seen_std_m, estimate)
        most_m = self._config.margin_m
        along_m, across_m = math.hypot(along_m, MET_STD_M), math.hypot(across_m, MET_STD_M)
        return min(SURE_SIGMA * along_m, most_m), min(SURE_SIGMA * across_m, most_m)
