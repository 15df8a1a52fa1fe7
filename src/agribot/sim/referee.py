"""Judges a simulated run against the truth that the robot never sees."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.core.encounter import Encounter
from agribot.core.field_bounds import FieldBounds
from agribot.core.geo import wrap_rad
from agribot.core.growing_table import GrowingTable
from agribot.core.implement.left_weeds import Passage, count_left
from agribot.core.messages import (
    ByteArray,
    MappedPlant,
    MapPoint,
    PlantClass,
    Row,
    TickRecord,
)
from agribot.core.robot import RobotSpec
from agribot.core.row_shape import row_length_m
from agribot.core.world import WorldSpec
from agribot.sim.driven_rows import DrivenRows
from agribot.sim.job_plants import JobPlants, PlantSource
from agribot.sim.mask_judge import MaskJudge
from agribot.sim.plant_judge import find_percentile, is_in_strips, match_plants
from agribot.sim.row_judge import FoundRowsScore, find_true_row, score_found_rows, shift_row
from agribot.sim.safety_judge import SafetyJudge, SafetyScore
from agribot.sim.scores import (
    ErrorSums,
    EstimateScore,
    RefereeState,
    TrackingScore,
    WeedScore,
    compute_root_mean,
)
from agribot.sim.true_weeds import TrueWeeds
from agribot.sim.truth import Truth
from agribot.sim.weed_reasons import PlantsOnMap


class TruthSource(PlantSource, Protocol):
    """The part of a simulator that the referee reads."""

    @property
    def person_distance_min_m(self) -> float | None: ...
    @property
    def visits(self) -> tuple[Encounter, ...]: ...
    @property
    def worked_m2(self) -> float: ...
    def truth(self) -> Truth: ...
    def truth_mask(self, frame_index: int) -> ByteArray | None: ...


class Referee:
    """A tap: call it with every TickRecord, then ask for the scores."""

    def __init__(
        self,
        source: TruthSource,
        world: WorldSpec,
        rows: Sequence[Row],
        goals_map_m: Sequence[tuple[float, float]] = (),
        bounds: FieldBounds | None = None,
        find_true_row: Callable[[Row], Row] = lambda row: row,
        robot: RobotSpec | None = None,
    ) -> None:
        """`rows` are those of the map; the judgement is by the line of their plants.

        `bounds` is what the robot must not leave, None if unknown; `robot` gives the promised
        stopping distances.
        """
        self._source = source
        self._find_true_row = find_true_row
        self._world = world
        self._implement = None if robot is None else robot.implement
        self._safety = SafetyJudge(bounds, robot)
        self._row_errors = GrowingTable(2)  # across_m, heading_rad; those not in the sums yet
        self._estimate_errors = GrowingTable(3)  # x_m, y_m, yaw_rad; likewise
        self._pose_covs = GrowingTable(9)
        self._across_m = GrowingTable(1)
        self._tally = ErrorSums()
        self._before: RefereeState | None = None
        self._distance_m = 0.0
        self._last_xy: tuple[float, float] | None = None
        self._masks, self._plants = MaskJudge(), JobPlants(source, world.plants)
        self._true_rows: tuple[Row, ...] = ()
        self.set_task(rows, goals_map_m)

    def set_task(
        self, rows: Sequence[Row], goals_map_m: Sequence[tuple[float, float]] = ()
    ) -> None:
        """Replace the rows and goals to judge; errors up to now still count."""
        self._driven = DrivenRows([self._find_true_row(row) for row in rows])
        self._goals_map_m = tuple(goals_map_m)
        self._nearest_m = [math.inf] * len(self._goals_map_m)

    def take_true_rows(self, rows: Sequence[Row]) -> None:
        """Take the rows of the map that a robot is to find."""
        self._true_rows = tuple(self._find_true_row(row) for row in rows)

    def match_rows(self, found: Sequence[Row], here_map_m: MapPoint) -> None:
        """Judge rows that were found by the true ones on which they lie.

        A row was found from where the robot believes to be, `here_map_m`: as far as that is wrong,
        so is the place of the row, and it is not another row for that.
        """
        rows = self._driven.by_index
        if all(row.index in rows for row in found):
            return
        truth = self._source.truth()
        off_m = truth.x_map_m - here_map_m[0], truth.y_map_m - here_map_m[1]
        for row in found:
            if row.index not in rows:
                there = shift_row(row, off_m)
                rows[row.index] = find_true_row(there, self._true_rows) or row

    def score_found_rows(self, found: Sequence[Row]) -> FoundRowsScore | None:
        """Score the rows that the robot found; None if it knew its rows."""
        if not self._true_rows:
            return None
        return score_found_rows(found, self._true_rows, self._driven.by_index)

    def restore(self, before: RefereeState) -> str:
        """Continue the judgement of an earlier run of the job.

        Returns the parts that cannot be continued, in words, or an empty string.
        """
        self._before, self._tally = before, before.tally
        self._safety.restore(before.safety)
        self._distance_m += before.distance_m
        self._masks.restore(before.confusion)
        self._driven.restore(before)
        for goal, nearest_m in zip(before.goals_map_m, before.nearest_m, strict=True):
            if goal in self._goals_map_m and nearest_m is not None:
                self._nearest_m[self._goals_map_m.index(goal)] = nearest_m
        if before.plants_total == len(self._world.plants):
            self._plants.restore(before)
            return ""
        self._before = None
        return "crushed and treated plants: the field has other plants now"

    def export_state(self) -> RefereeState:
        """Return the state until now, for the run that continues the job."""
        self._add_to_sums()
        driven, plants = self._driven, self._plants
        return RefereeState(
            tally=self._tally,
            distance_m=self._distance_m,
            confusion=tuple(self._masks.confusion.ravel().tolist()),
            rows=driven.rows,
            worst_m=driven.worst_m,
            slices=tuple(sorted(driven.slices)),
            goals_map_m=self._goals_map_m,
            nearest_m=tuple(n if math.isfinite(n) else None for n in self._nearest_m),
            crushed=tuple(sorted(plants.crushed_by)),
            crushed_by=tuple(int(by) for _, by in sorted(plants.crushed_by.items())),
            brushed=tuple(sorted(plants.brushed)),
            person_distance_min_m=self._find_person_distance_m(),
            treated=tuple(sorted(plants.treated)),
            worked_m2=self.worked_m2,
            wet_leaves=plants.wet_leaves,
            offsets_m=plants.offsets_m,
            looks=plants.looks,
            plants_total=len(self._world.plants),
            safety=self._safety.export_state(),
        )

    def note_fault(self) -> None:
        """Note that a fault begins: what is crushed from now on counts as after it."""
        if self._safety.crushed_before is None:
            self._safety.crushed_before = frozenset(self._plants.crushed_by)

    def score_safety(self) -> SafetyScore:
        score = self._safety.score(self.crushed, self._plants.list_crushes())
        return msgspec.structs.replace(
            score, person_distance_min_m=self._find_person_distance_m(),
            visits=self._source.visits,
        )  # fmt: skip

    def __call__(self, record: TickRecord) -> None:
        truth = self._source.truth()
        x_m, y_m, yaw_rad = truth.x_map_m, truth.y_map_m, truth.yaw_map_rad
        if self._last_xy is not None:
            self._distance_m += math.hypot(x_m - self._last_xy[0], y_m - self._last_xy[1])
        self._last_xy = (x_m, y_m)
        self._safety.look(record, truth)
        for index, goal in enumerate(self._goals_map_m):
            distance_m = math.dist(goal, self._last_xy)
            self._nearest_m[index] = min(self._nearest_m[index], distance_m)
        row = self._driven.by_index.get(record.status.row)
        is_running = record.status.state == "running"
        errors = self._driven.judge(row, x_m, y_m, yaw_rad) if row and is_running else None
        if errors is not None:
            self._row_errors.append(errors)
        if record.estimate.ok:
            self._judge_estimate(record, x_m, y_m, yaw_rad)

    def judge_mask(self, frame_index: int, class_id: ByteArray) -> None:
        """Add a predicted class mask (height, width), of any size, to the confusion matrix."""
        truth = self._source.truth_mask(frame_index)
        if truth is not None:
            self._masks.add(truth, class_id)

    @property
    def confusion(self) -> npt.NDArray[np.int64]:
        """Pixels of all judged masks, (3, 3): rows the true class, columns the network's."""
        return self._masks.confusion

    @property
    def rows(self) -> tuple[Row, ...]:
        """The lines of the plants that stand along the rows of the task."""
        return self._driven.rows

    @property
    def has_rows(self) -> bool:
        return bool(self._driven.by_index)

    def list_rows_kept(self, rows_done: Sequence[int]) -> tuple[int, ...]:
        """Return those of `rows_done` that the robot truly kept."""
        return self._driven.list_kept(rows_done)

    def count_waypoints_kept(self, radius_m: float) -> int:
        """Count the waypoints that the robot truly came near, in any order."""
        return sum(distance_m <= radius_m for distance_m in self._nearest_m)

    def compute_coverage_ratio(self) -> float:
        """Return the share of all row length that was truly driven."""
        return self._driven.compute_coverage_ratio()

    def compute_iou(self) -> dict[str, float | None]:
        """Return the IoU per class of all judged masks; None for a class that never occurred."""
        return self._masks.compute_iou()

    def score_tracking(self) -> TrackingScore:
        self._add_to_sums()
        tally = self._tally
        is_one_run = len(self._across_m) == tally.row_ticks > 0
        p95_m = float(np.percentile(self._across_m.to_array(), 95)) if is_one_run else None
        return TrackingScore(
            xte_rms_m=compute_root_mean(tally.across_m2, tally.row_ticks),
            xte_p95_m=p95_m if is_one_run else tally.across_m.percentile(95.0),
            xte_max_m=tally.across_max_m if tally.row_ticks else None,
            heading_rms_rad=compute_root_mean(tally.heading_rad2, tally.row_ticks),
            distance_m=self._distance_m,
            plants_total=sum(p.plant == PlantClass.CROP for p in self._world.plants),
            plants_crushed=len(self._plants.crushed_by),
            plants_crushed_by=self._plants.count_crushed(),
            plants_brushed=len(self._plants.brushed),
        )

    def score_estimate(self) -> EstimateScore:
        self._add_to_sums()
        return self._tally.score_estimate()

    @property
    def worked_m2(self) -> float:
        """Ground that the implement truly worked; passing twice counts twice."""
        return self._source.worked_m2 + (self._before.worked_m2 if self._before else 0)

    def compute_worked_area_ratio(self, rows_done: Sequence[int]) -> float | None:
        """Divide the worked ground by that of the finished rows, each as wide as their pitch."""
        rows, pitch_m = self._driven.by_index, self._driven.pitch_m
        area_m2 = sum(row_length_m(rows[index]) * pitch_m for index in rows_done)
        return self.worked_m2 / area_m2 if area_m2 else None

    def score_weeds(
        self,
        weeds: Sequence[MappedPlant],
        crops: Sequence[MappedPlant],
        rows_done: Sequence[int],
        not_passed: str,
    ) -> WeedScore:
        """Score plants along finished rows; a crop that the robot crushed stood there, and counts.

        Crops hit are those of the whole world, untreated weeds those of all rows. `not_passed` is
        why ground of the rows was not driven.
        """
        strips = [self._driven.by_index[index] for index in rows_done]
        pitch_m, job = self._driven.pitch_m, self._plants
        plants = self._world.plants
        weed = match_plants(PlantClass.WEED, weeds, plants, strips, pitch_m)
        crop = match_plants(PlantClass.CROP, crops, plants, strips, pitch_m)
        along = [m for m in weeds if is_in_strips(m.x_map_m, m.y_map_m, strips, pitch_m)]
        offsets_m = [*job.offsets_m.values()]
        passage = self._describe_passage(not_passed)
        true = TrueWeeds(plants, self.rows, pitch_m, job.treated)
        in_row, between_rows = true.share_by_rows(strips)
        return WeedScore(
            truth=weed.truth,
            mapped=weed.mapped,
            matched=len(weed.distances_m),
            precision=weed.precision,
            recall=weed.recall,
            f1=weed.f1,
            pos_error_median_m=find_percentile(weed.distances_m, 50.0),
            placement_p90_m=find_percentile(weed.distances_m, 90.0),
            crops_truth=crop.truth,
            crops_mapped=crop.mapped,
            crop_recall=crop.recall,
            stem_error_p95_m=find_percentile(weed.distances_m + crop.distances_m, 95.0),
            treated=sum(m.treated_s is not None for m in along),
            treated_true=job.count_treated(PlantClass.WEED, strips, pitch_m),
            crops_hit=job.count_treated(PlantClass.CROP),
            worked_area_ratio=self.compute_worked_area_ratio(rows_done),
            left=count_left(along, passage),
            crop_leaves_wet_ratio=job.compute_wet_ratio(strips, pitch_m),
            tool_offset_p50_m=find_percentile(offsets_m, 50.0),
            tool_offset_p90_m=find_percentile(offsets_m, 90.0),
            in_row=in_row,
            between_rows=between_rows,
            untreated=true.count_untreated(PlantsOnMap(weeds, crops), passage, job.looks),
        )

    def _describe_passage(self, not_passed: str) -> Passage:
        """Describe where the tool passed: where the robot was driven before and behind it."""
        spec = self._implement
        reach_m = 0.0 if spec is None else abs(spec.x_body_m)

        def is_passed(row: Row, along_m: float) -> bool:
            ends_m = along_m - reach_m, along_m + reach_m
            return all(self._driven.is_driven(row, end_m) for end_m in ends_m)

        width_m = None if spec is None else spec.width_m
        return Passage(self.rows, is_passed, width_m, not_passed)

    def _find_person_distance_m(self) -> float | None:
        """Return how near the robot came to a person, in the runs before this one as well."""
        before = self._before.person_distance_min_m if self._before else None
        known = [d for d in (before, self._source.person_distance_min_m) if d is not None]
        return min(known, default=None)

    @property
    def crushed(self) -> set[int]:
        """Crops crushed in the whole job, as indices into the world's plants."""
        return set(self._plants.crushed_by)

    def _add_to_sums(self) -> None:
        """Add the newest errors to the sums."""
        rows = self._row_errors.to_array()
        for across_m in np.abs(rows[:, 0]):
            self._across_m.append((across_m,))
        self._tally.add_rows(rows)
        self._tally.add_estimates(self._estimate_errors.to_array(), self._pose_covs.to_array())
        self._row_errors, self._estimate_errors = GrowingTable(2), GrowingTable(3)
        self._pose_covs = GrowingTable(9)

    def _judge_estimate(self, record: TickRecord, x_m: float, y_m: float, yaw_rad: float) -> None:
        estimate = record.estimate
        yaw_error_rad = wrap_rad(estimate.yaw_map_rad - yaw_rad)
        self._estimate_errors.append(
            (estimate.x_map_m - x_m, estimate.y_map_m - y_m, yaw_error_rad)
        )
        self._pose_covs.append(estimate.pose_cov)
