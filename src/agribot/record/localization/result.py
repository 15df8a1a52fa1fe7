"""What a log gave, as numbers; a value that could not be measured is null."""

from __future__ import annotations

import msgspec

from agribot.core.geo import Datum
from agribot.core.messages import FloatArray

# Files of a result's folder; no log of a drive.
OUTPUT_NAMES = (
    "poses.csv", "poses.tum", "poses.gpx", "estimate.mcap", "report.html", "pictures.csv",
)  # fmt: skip
# Columns of the tables for figures.
POSE_COLUMNS = ("t_s", "x_map_m", "y_map_m", "yaw_map_rad", "pos_std_m")
FIX_COLUMNS = ("t_s", "x_map_m", "y_map_m", "std_m", "off_m", "nis", "is_given")


class OutageResult(msgspec.Struct, frozen=True, kw_only=True):
    """Fixes withheld from `from_s` to `to_s`, seconds from the first message of the log.

    `driven_m` is the way by the wheels meanwhile, `error_m` the mean distance of the withheld
    fixes of the last 3 s from the estimate, `sigma_m` the 1 sigma that it states at the end.
    """

    from_s: float
    to_s: float
    driven_m: float | None = None
    error_m: float | None = None
    sigma_m: float | None = None


class LocalizationResult(msgspec.Struct, frozen=True, kw_only=True):
    """The last line of `agribot localize --json`.

    `rms_to_fixes_m` is of the fixes that were given, from 60 s on, against the estimate with them.
    `within_3_sigma_ratio` and `nis_mean` (2 of an honest filter) compare each with the estimate
    just before it, by the covariance of the pose and the receiver's own sigma.
    """

    fixes: int
    used: int
    started_after_s: float | None
    started_after_m: float | None
    rms_to_fixes_m: float | None
    within_3_sigma_ratio: float | None
    outages: tuple[OutageResult, ...]
    nis_mean: float | None
    reason: str


class LocalizationRun(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One pass of the filter over a log, with what the page shows of it.

    `poses` and `fixes` (N, columns) are thinned; `rejected` counts what the filter left out, by
    its own words; `settings` are those on top of the defaults.
    """

    result: LocalizationResult
    poses: FloatArray
    fixes: FloatArray
    datum: Datum
    duration_s: float
    driven_m: float
    settings: tuple[str, ...] = ()
    rejected: dict[str, int] = {}
    stops: tuple[tuple[float, str], ...] = ()


class SourceFact(msgspec.Struct, frozen=True, kw_only=True):
    """Source of a sensor; times count from the first message of the log."""

    sensor: str
    source: str
    kind: str
    messages: int
    measurements: int
    from_s: float
    to_s: float


class LogFacts(msgspec.Struct, frozen=True, kw_only=True):
    """Content of a log; `start_stamp_s` is the stamp of its first message.

    `notes` say what is not used, not known or assumed, in words.
    """

    name: str
    start_stamp_s: float
    sources: tuple[SourceFact, ...]
    mount: str
    robot: tuple[str, ...]
    notes: tuple[str, ...] = ()
