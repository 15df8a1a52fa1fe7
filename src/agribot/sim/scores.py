"""The referee's scores of a job, and the sums that one run hands to the next."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from agribot.core.histogram import Histogram
from agribot.core.implement.row_shares import TreatedShare
from agribot.core.messages import FloatArray, Row
from agribot.sim.safety_judge import SafetyState

BIN_M = 0.0005  # bin of the cross-track error, for its percentile over several runs


class CrushedCount(msgspec.Struct, frozen=True, kw_only=True):
    """Count of crops crushed by each part of the robot."""

    wheel: int = 0
    belly: int = 0
    implement: int = 0


class TrackingScore(msgspec.Struct, frozen=True, kw_only=True):
    """True errors against the row line, over all ticks inside rows; None without any."""

    xte_rms_m: float | None
    xte_p95_m: float | None
    xte_max_m: float | None
    heading_rms_rad: float | None
    distance_m: float
    plants_total: int
    plants_crushed: int
    plants_crushed_by: CrushedCount
    plants_brushed: int


class EstimateScore(msgspec.Struct, frozen=True, kw_only=True):
    """Error of the estimate over all ticks in which it was marked as good."""

    pos_rms_m: float | None
    yaw_rms_rad: float | None
    nees_mean: float | None


class WeedScore(msgspec.Struct, frozen=True, kw_only=True):
    """Mapped against true plants in the strips of the finished rows.

    Without a word of crops or stems a figure is of the weeds; `placement_p90_m` is the distance
    of matched weeds, `stem_error_p95_m` that of matched plants of both classes. `untreated` counts
    the true weeds of all rows, finished or not, that were not treated by the reason why.
    """

    truth: int
    mapped: int
    matched: int
    precision: float | None
    recall: float | None
    f1: float | None
    pos_error_median_m: float | None
    placement_p90_m: float | None
    crops_truth: int
    crops_mapped: int
    crop_recall: float | None
    stem_error_p95_m: float | None
    treated: int
    treated_true: int
    crops_hit: int
    worked_area_ratio: float | None
    left: dict[str, int]
    crop_leaves_wet_ratio: float | None
    tool_offset_p50_m: float | None
    tool_offset_p90_m: float | None
    in_row: TreatedShare
    between_rows: TreatedShare
    untreated: dict[str, int]


class ErrorSums(msgspec.Struct, kw_only=True):
    """Sums over ticks: in rows against their line, and with a good estimate against the truth."""

    row_ticks: int = 0
    across_m2: float = 0.0
    heading_rad2: float = 0.0
    across_max_m: float = 0.0
    across_m: Histogram = msgspec.field(default_factory=lambda: Histogram(width=BIN_M))
    estimate_ticks: int = 0
    position_m2: float = 0.0
    yaw_rad2: float = 0.0
    nees: float = 0.0

    def add_rows(self, errors: FloatArray) -> None:
        """Add errors against a row's line, (N, 2): across_m, heading_rad."""
        if not len(errors):
            return
        across_m = np.abs(errors[:, 0])
        self.row_ticks += len(errors)
        self.across_m2 += float(np.sum(across_m**2))
        self.heading_rad2 += float(np.sum(errors[:, 1] ** 2))
        self.across_max_m = max(self.across_max_m, float(across_m.max()))
        self.across_m.add(across_m)

    def add_estimates(self, errors: FloatArray, covs: FloatArray) -> None:
        """Add errors of the estimate, (N, 3): x_m, y_m, yaw_rad, with its covariances (N, 9)."""
        if not len(errors):
            return
        solved = np.linalg.solve(covs.reshape(-1, 3, 3), errors[..., None])[..., 0]
        self.estimate_ticks += len(errors)
        self.position_m2 += float(np.sum(errors[:, :2] ** 2))
        self.yaw_rad2 += float(np.sum(errors[:, 2] ** 2))
        self.nees += float(np.einsum("ni,ni->", errors, solved))

    def score_estimate(self) -> EstimateScore:
        count = self.estimate_ticks
        return EstimateScore(
            pos_rms_m=compute_root_mean(self.position_m2, count),
            yaw_rms_rad=compute_root_mean(self.yaw_rad2, count),
            nees_mean=self.nees / count if count else None,
        )


class RefereeState(msgspec.Struct, frozen=True, kw_only=True):
    """The referee's state in a job, for the run that continues it.

    `worst_m` and `slices` belong to `rows` by their index, `nearest_m` to the goals; None: not
    seen yet. Crushed, brushed and treated plants are indices into the `plants_total` of the world.
    """

    tally: ErrorSums
    distance_m: float
    confusion: tuple[int, ...]
    rows: tuple[Row, ...]
    worst_m: dict[int, float]
    slices: tuple[tuple[int, int], ...]
    goals_map_m: tuple[tuple[float, float], ...]
    nearest_m: tuple[float | None, ...]
    crushed: tuple[int, ...]
    crushed_by: tuple[int, ...] = ()  # cause of each of `crushed`; as `Part`
    brushed: tuple[int, ...] = ()
    person_distance_min_m: float | None = None
    treated: tuple[int, ...] = msgspec.field(name="sprayed")
    worked_m2: float = msgspec.field(name="sprayed_area_m2")
    wet_leaves: dict[int, float] = {}
    offsets_m: dict[int, float] = {}
    looks: dict[int, int] = {}
    plants_total: int
    safety: SafetyState = SafetyState()


def compute_root_mean(square_sum: float, count: int) -> float | None:
    """Return the root mean square; None without samples."""
    return math.sqrt(square_sum / count) if count else None
