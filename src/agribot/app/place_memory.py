"""Where a machine was left by its last run, for the check of the next start.

It is kept while the robot stands with fixed ambiguities, and dropped as soon as its wheels turn: a
program that ends on the way leaves nothing.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime

import msgspec

from agribot.autonomy.estimate.witnesses.start_agreement import LEFT_STD_M
from agribot.core.config import FieldConfig
from agribot.core.geo import MapFrame
from agribot.core.home import find_machine_file
from agribot.core.messages import Estimate, GnssQuality, TickRecord
from agribot.core.whole_file import write_at_once

FOLDER = "places"
# Time of standing after which a place is kept, s; way of the wheels that drops it, m.
STANDS_S, MOVED_M = 1.0, 0.02
STANDING_MPS = 0.01


class LeftPlace(msgspec.Struct, frozen=True, kw_only=True):
    """A place on the Earth, and when the robot came to stand there."""

    lat_deg: float
    lon_deg: float
    since: str


class PlaceMemory:
    """A tap: keeps the place of a standing machine in one file. A thread writes it.

    A disk that takes no file loses one check of the next start, and nothing else.
    """

    def __init__(self, platform: str, field: FieldConfig) -> None:
        self.path = find_machine_file(FOLDER, platform)
        self._field, self._frame = field, MapFrame(field.datum)
        self._stood_s = self._way_m = 0.0
        self._is_kept = self.path.exists()
        self._last_t_s: float | None = None
        self._writer = ThreadPoolExecutor(max_workers=1, thread_name_prefix="place-memory")

    def recall(self) -> FieldConfig:
        """Return the settings of the field with the place; as they were where there is not one."""
        if self._field.left_map_m is not None:
            return self._field
        try:
            left = msgspec.json.decode(self.path.read_bytes(), type=LeftPlace)
        except (OSError, msgspec.DecodeError, UnicodeDecodeError):
            return self._field
        alt_m = self._field.datum.alt_m
        east_m, north_m, _ = self._frame.map_from_geodetic(left.lat_deg, left.lon_deg, alt_m)
        return msgspec.structs.replace(self._field, left_map_m=(east_m, north_m))

    def __call__(self, record: TickRecord) -> None:
        estimate, last_s = record.estimate, self._last_t_s
        self._last_t_s = estimate.t_s
        if last_s is None:
            return
        step_s = estimate.t_s - last_s
        is_still = abs(estimate.v_mps) < STANDING_MPS
        self._stood_s = self._stood_s + step_s if is_still else 0.0
        self._way_m += abs(estimate.v_mps) * step_s
        if not is_still and self._is_kept and self._way_m > MOVED_M:
            self._is_kept = False
            self._writer.submit(self.path.unlink, missing_ok=True)
        if self._stood_s >= STANDS_S and not self._is_kept and _is_sure(estimate):
            self._is_kept, self._way_m = True, 0.0
            self._writer.submit(self._keep, self._place(estimate))

    def close(self) -> None:
        """Wait for the last write. Safe to call twice."""
        self._writer.shutdown()

    def _place(self, estimate: Estimate) -> LeftPlace:
        lat_deg, lon_deg, _ = self._frame.geodetic_from_map(estimate.x_map_m, estimate.y_map_m, 0.0)
        since = datetime.now(UTC).isoformat(timespec="seconds")
        return LeftPlace(lat_deg=lat_deg, lon_deg=lon_deg, since=since)

    def _keep(self, left: LeftPlace) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_at_once(self.path, msgspec.json.encode(left), is_synced=True)


def _is_sure(estimate: Estimate) -> bool:
    is_fixed = estimate.quality is GnssQuality.RTK_FIXED and estimate.pos_std_m <= LEFT_STD_M
    return estimate.ok and is_fixed and not estimate.contradiction
