"""Judges a simulated run against the truth that the robot never sees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import msgspec
import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from agribot.geo import wrap_rad
from agribot.growing_table import GrowingTable
from agribot.mapped_plant import MappedPlant
from agribot.messages import ByteArray, FloatArray, PlantClass, Row, TickRecord
from agribot.row_shape import beside_row, row_length_m
from agribot.sim.truth import Truth
from agribot.world import Plant, WorldSpec

MATCH_RADIUS_M = 0.10  # a mapped weed farther from every true one is a false alarm
KEPT_ROW_M = 0.25  # farther off than this, the wheels come near the plants: the row was not driven
SLICE_M = 0.25  # of row length, for the coverage


class TruthSource(Protocol):
    """What the referee asks of a simulator."""

    @property
    def crushed(self) -> set[int]: ...
    @property
    def sprayed(self) -> dict[int, float]: ...
    @property
    def sprayed_area_m2(self) -> float: ...
    def truth(self) -> Truth: ...
    def truth_mask(self, frame_index: int) -> ByteArray | None: ...


class TrackingScore(msgspec.Struct, frozen=True, kw_only=True):
    """True errors against the row line, over all ticks inside rows; None without any."""

    xte_rms_m: float | None
    xte_p95_m: float | None
    xte_max_m: float | None
    heading_rms_rad: float | None
    distance_m: float
    plants_total: int
    plants_crushed: int


class EstimateScore(msgspec.Struct, frozen=True, kw_only=True):
    """Error of the estimate over all ticks in which it called itself good."""

    pos_rms_m: float | None
    yaw_rms_rad: float | None
    nees_mean: float | None


class WeedScore(msgspec.Struct, frozen=True, kw_only=True):
    """Mapped against true weeds in the strips of the finished rows."""

    truth: int
    mapped: int
    matched: int
    precision: float | None
    recall: float | None
    f1: float | None
    pos_error_median_m: float | None
    treated: int
    treated_true: int
    crops_hit: int
    spray_area_ratio: float | None


class Referee:
    """A tap: call it with every TickRecord, then ask for the scores."""

    def __init__(
        self,
        source: TruthSource,
        world: WorldSpec,
        rows: Sequence[Row],
        goals_map_m: Sequence[tuple[float, float]] = (),
    ) -> None:
        self._source = source
        self._world = world
        self._row_errors = GrowingTable(2)  # across_m, heading_rad
        self._estimate_errors = GrowingTable(3)  # x_m, y_m, yaw_rad
        self._pose_covs = GrowingTable(9)
        self._distance_m = 0.0
        self._last_xy: tuple[float, float] | None = None
        self._confusion = np.zeros((3, 3), dtype=np.int64)
        self.judge_anew(rows, goals_map_m)

    def judge_anew(
        self, rows: Sequence[Row], goals_map_m: Sequence[tuple[float, float]] = ()
    ) -> None:
        """Another task: what was kept of the old one counts no more. Errors already made do."""
        self._rows = {row.index: row for row in rows}
        self._goals_map_m = tuple(goals_map_m)
        self._nearest_m = [math.inf] * len(self._goals_map_m)
        self._worst_m: dict[int, float] = {}
        self._slices: set[tuple[int, int]] = set()

    def __call__(self, record: TickRecord) -> None:
        truth = self._source.truth()
        x_m, y_m, yaw_rad = truth.x_map_m, truth.y_map_m, truth.yaw_map_rad
        if self._last_xy is not None:
            self._distance_m += math.hypot(x_m - self._last_xy[0], y_m - self._last_xy[1])
        self._last_xy = (x_m, y_m)
        for index, goal in enumerate(self._goals_map_m):
            distance_m = math.dist(goal, self._last_xy)
            self._nearest_m[index] = min(self._nearest_m[index], distance_m)
        row = self._rows.get(record.status.row)
        if row is not None and record.status.state == "running":
            self._judge_row(row, x_m, y_m, yaw_rad)
        if record.estimate.ok:
            self._judge_estimate(record, x_m, y_m, yaw_rad)

    def judge_mask(self, frame_index: int, class_id: ByteArray) -> None:
        """Add one predicted class mask, at any resolution, to the pooled confusion matrix."""
        truth = self._source.truth_mask(frame_index)
        if truth is None:
            return
        predicted = _nearest(class_id, truth.shape)
        pairs = truth.astype(np.int64) * 3 + predicted
        self._confusion += np.bincount(pairs.ravel(), minlength=9).reshape(3, 3)

    @property
    def confusion(self) -> npt.NDArray[np.int64]:
        """Pixels of all judged masks, (3, 3): rows the true class, columns the network's."""
        return self._confusion.copy()

    @property
    def has_rows(self) -> bool:
        return bool(self._rows)

    def rows_kept(self, rows_done: Sequence[int]) -> tuple[int, ...]:
        """Of the rows that the robot believes done, those it truly kept within KEPT_ROW_M."""
        return tuple(row for row in rows_done if self._worst_m.get(row, math.inf) <= KEPT_ROW_M)

    def waypoints_kept(self, radius_m: float) -> int:
        """How many waypoints the robot truly came near, in whatever order."""
        return sum(distance_m <= radius_m for distance_m in self._nearest_m)

    def coverage_ratio(self) -> float:
        """Share of all row length that was truly driven within KEPT_ROW_M."""
        total = sum(math.ceil(row_length_m(row) / SLICE_M) for row in self._rows.values())
        return len(self._slices) / total if total else 0.0

    def iou(self) -> dict[str, float | None]:
        """Per class, from the pooled confusion matrix; None for a class that never occurred."""
        hit = np.diag(self._confusion)
        union = self._confusion.sum(0) + self._confusion.sum(1) - hit
        return {
            plant.name.lower(): float(hit[plant] / union[plant]) if union[plant] else None
            for plant in PlantClass
        }

    def tracking(self) -> TrackingScore:
        errors = self._row_errors.array()
        crops = [p for p in self._world.plants if p.plant == PlantClass.CROP]
        known = errors.shape[0] > 0
        across = np.abs(errors[:, 0])
        return TrackingScore(
            xte_rms_m=_rms(errors[:, 0]),
            xte_p95_m=float(np.percentile(across, 95)) if known else None,
            xte_max_m=float(across.max()) if known else None,
            heading_rms_rad=_rms(errors[:, 1]),
            distance_m=self._distance_m,
            plants_total=len(crops),
            plants_crushed=len(self._source.crushed),
        )

    def estimate(self) -> EstimateScore:
        if not self._estimate_errors:
            return EstimateScore(pos_rms_m=None, yaw_rms_rad=None, nees_mean=None)
        error = self._estimate_errors.array()
        cov = self._pose_covs.array().reshape(-1, 3, 3)
        nees = np.einsum("ni,ni->n", error, np.linalg.solve(cov, error[..., None])[..., 0])
        return EstimateScore(
            pos_rms_m=float(np.sqrt((error[:, :2] ** 2).sum(axis=1).mean())),
            yaw_rms_rad=_rms(error[:, 2]),
            nees_mean=float(nees.mean()),
        )

    def weeds(self, mapped: Sequence[MappedPlant], rows_done: Sequence[int]) -> WeedScore:
        strips = [self._rows[index] for index in rows_done]
        pitch_m = self._pitch_m()
        truth = [
            p
            for p in self._world.plants
            if p.plant == PlantClass.WEED and _in_strips(p.x_map_m, p.y_map_m, strips, pitch_m)
        ]
        inside = [m for m in mapped if _in_strips(m.x_map_m, m.y_map_m, strips, pitch_m)]
        distances = _match(inside, [p for p in self._world.plants if p.plant == PlantClass.WEED])
        recalled = len(_match(mapped, truth))
        precision = len(distances) / len(inside) if inside else None
        recall = recalled / len(truth) if truth else None
        return WeedScore(
            truth=len(truth),
            mapped=len(inside),
            matched=len(distances),
            precision=precision,
            recall=recall,
            f1=_f1(precision, recall),
            pos_error_median_m=float(np.median(distances)) if distances else None,
            treated=sum(m.treated_s is not None for m in mapped),
            treated_true=self._sprayed(PlantClass.WEED),
            crops_hit=self._sprayed(PlantClass.CROP),
            spray_area_ratio=self._spray_ratio(strips, pitch_m),
        )

    def _judge_row(self, row: Row, x_m: float, y_m: float, yaw_rad: float) -> None:
        along_m, across_m, row_yaw_rad = map(float, beside_row(row, x_m, y_m))
        if not 0.0 <= along_m <= row_length_m(row):
            return
        heading = wrap_rad(yaw_rad - row_yaw_rad)
        if abs(heading) > math.pi / 2:  # driven against the row's direction
            heading = wrap_rad(heading - math.pi)
        self._row_errors.append((across_m, heading))
        self._worst_m[row.index] = max(self._worst_m.get(row.index, 0.0), abs(across_m))
        if abs(across_m) <= KEPT_ROW_M:
            last = math.ceil(row_length_m(row) / SLICE_M) - 1
            self._slices.add((row.index, min(int(along_m / SLICE_M), last)))

    def _judge_estimate(self, record: TickRecord, x_m: float, y_m: float, yaw_rad: float) -> None:
        estimate = record.estimate
        yaw_error_rad = wrap_rad(estimate.yaw_map_rad - yaw_rad)
        self._estimate_errors.append(
            (estimate.x_map_m - x_m, estimate.y_map_m - y_m, yaw_error_rad)
        )
        self._pose_covs.append(estimate.pose_cov)

    def _pitch_m(self) -> float:
        """Distance between neighbouring rows; a lone row counts as one metre wide."""
        rows = [self._rows[index] for index in sorted(self._rows)]
        if len(rows) < 2:
            return 1.0
        return abs(float(beside_row(rows[0], *rows[1].start_map_m).left_m))

    def _sprayed(self, plant: PlantClass) -> int:
        return sum(self._world.plants[index].plant == plant for index in self._source.sprayed)

    def _spray_ratio(self, strips: Sequence[Row], pitch_m: float) -> float | None:
        area_m2 = sum(row_length_m(row) * pitch_m for row in strips)
        return self._source.sprayed_area_m2 / area_m2 if area_m2 else None


def _in_strips(x_m: float, y_m: float, rows: Sequence[Row], pitch_m: float) -> bool:
    for row in rows:
        along_m, across_m, _ = beside_row(row, x_m, y_m)
        if 0.0 <= along_m <= row_length_m(row) and abs(across_m) <= pitch_m / 2:
            return True
    return False


def _match(mapped: Sequence[MappedPlant], truth: Sequence[Plant]) -> list[float]:
    """Distances of the one-to-one pairs within MATCH_RADIUS_M (Hungarian assignment)."""
    if not mapped or not truth:
        return []
    mapped_xy = np.array([(m.x_map_m, m.y_map_m) for m in mapped])
    truth_xy = np.array([(p.x_map_m, p.y_map_m) for p in truth])
    distance = np.linalg.norm(mapped_xy[:, None] - truth_xy[None], axis=2)
    cost = np.where(distance <= MATCH_RADIUS_M, distance, 1e3)
    pairs = linear_sum_assignment(cost)
    return [float(d) for d in distance[pairs] if d <= MATCH_RADIUS_M]


def _f1(precision: float | None, recall: float | None) -> float | None:
    if precision is None or recall is None:
        return None
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def _rms(values: FloatArray) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if len(values) else None


def _nearest(mask: ByteArray, shape: tuple[int, ...]) -> ByteArray:
    rows = (np.arange(shape[0]) + 0.5) * mask.shape[0] / shape[0]
    cols = (np.arange(shape[1]) + 0.5) * mask.shape[1] / shape[1]
    picked: ByteArray = mask[rows.astype(int)[:, None], cols.astype(int)[None]]
    return picked
