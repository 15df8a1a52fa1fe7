"""What the page's card of the GNSS receiver shows: its fixes, sky, corrections and line."""

from __future__ import annotations

from urllib.parse import parse_qsl

from agribot.core.config import RunConfig
from agribot.core.fact_text import render
from agribot.core.facts import CorrectionsCome, CorrectionsMissing, Fact, LineClean, LineNoisy
from agribot.core.messages import (
    GnssFix,
    GnssStatus,
    Satellite,
    SensorBatch,
)
from agribot.core.platforms import runs_in_real_time
from agribot.ui import wire

RATE_OVER_S = 2.0  # time over which the rate of fixes is measured; a longer pause begins it anew
STATUS_LATE_S = 5.0  # age at which satellites, dilutions and corrections are no longer shown
MOST_SHOWN = 64  # satellites; those that are used and strong first


class ReceiverView:
    """Follows the receiver tick by tick; `show` may be called from another thread.

    Values without a source are None or empty. Ages are those at the time of the tick.
    """

    def __init__(self, config: RunConfig) -> None:
        uri = config.sources.gnss
        self._device, _, options = uri.partition("?")
        self._caster = dict(parse_qsl(options)).get("ntrip", "")
        self._caster_state: wire.CasterState | None = "asked" if self._caster else None
        self._is_simulated = not uri and not runs_in_real_time(config.platform)
        self._fix: GnssFix | None = None
        self._status: GnssStatus | None = None
        self._correction_hz: float | None = None
        self._use_ratio: float | None = None
        self._correction_trouble = self._line_trouble = ""
        self._rate = FixRate()
        self._t_s = 0.0

    def __call__(self, batch: SensorBatch) -> None:
        self._t_s = batch.t_s
        for fix in batch.gnss:
            self._fix = fix
            self._rate.add(fix.t_s)
        for status in batch.gnss_status:
            self._correction_hz = _measure_corrections_hz(self._status, status)
            self._use_ratio = _measure_use_ratio(self._status, status)
            self._status = status
        for note in batch.notes:
            self._hear(note.fact)

    def show(self) -> wire.ReceiverState:
        """Make the message of what is known by now."""
        fix, status, t_s = self._fix, self._status, self._t_s
        status_age_s = None if status is None else max(t_s - status.t_s, 0.0)
        is_current = status_age_s is not None and status_age_s <= STATUS_LATE_S
        shown = status if status is not None and is_current else GnssStatus(t_s=t_s)
        age_s = shown.correction_age_s
        return wire.ReceiverState(
            is_simulated=self._is_simulated,
            device=self._device,
            fix_age_s=None if fix is None else round(max(t_s - fix.t_s, 0.0), 1),
            quality=0 if fix is None else int(fix.quality),
            std_m=None if fix is None else _shorten(fix.pos_std_m),
            rate_hz=self._rate.rate_hz,
            status_age_s=None if status_age_s is None else round(status_age_s),
            satellites=_choose_shown(shown.satellites),
            used_count=sum(each.is_used for each in shown.satellites),
            in_view_count=len(shown.satellites),
            hdop=_round_dop(shown.hdop),
            pdop=_round_dop(shown.pdop),
            vdop=_round_dop(shown.vdop),
            correction_age_s=None if age_s is None else round(age_s + max(t_s - shown.t_s, 0.0), 1),
            correction_hz=self._correction_hz if is_current else None,
            correction_use_ratio=self._use_ratio if is_current else None,
            caster=self._caster,
            caster_state=self._caster_state,
            correction_trouble=self._correction_trouble,
            line_trouble=self._line_trouble,
            unmeasured="" if fix is None else fix.unmeasured,
            position_trouble=shown.trouble,
            unread=list(shown.unread),
        )

    def _hear(self, fact: Fact) -> None:
        match fact:
            case CorrectionsMissing():
                self._correction_trouble, self._caster_state = render(fact), "failed"
            case CorrectionsCome():
                self._correction_trouble, self._caster_state = "", "connected"
            case LineNoisy(device="receiver"):
                self._line_trouble = render(fact)
            case LineClean(device="receiver"):
                self._line_trouble = ""


class FixRate:
    """Fixes per second of their own time, None before it is known and after a pause."""

    def __init__(self) -> None:
        self.rate_hz: float | None = None
        self._begin_s = self._last_s = float("-inf")
        self._count = 0

    def add(self, t_s: float) -> None:
        if not 0.0 < t_s - self._last_s <= RATE_OVER_S:
            self.rate_hz, self._begin_s, self._count = None, t_s, -1
        self._last_s = t_s
        self._count += 1
        passed_s = t_s - self._begin_s
        if passed_s >= RATE_OVER_S:
            self.rate_hz = round(self._count / passed_s, 1)
            self._begin_s, self._count = t_s, 0


def _measure_corrections_hz(before: GnssStatus | None, now: GnssStatus) -> float | None:
    """Count the corrections passed on between two statuses, where somebody counts them."""
    if before is None or not now.correction_counts or now.t_s <= before.t_s:
        return None
    new = sum(n for _, n in now.correction_counts) - sum(n for _, n in before.correction_counts)
    return round(max(new, 0) / (now.t_s - before.t_s), 1)


def _measure_use_ratio(before: GnssStatus | None, now: GnssStatus) -> float | None:
    """Measure the share of corrections that the receiver used; None if it reported none."""
    if before is None or now.corrections_used is None or now.corrections_unused is None:
        return None
    used = now.corrections_used - (before.corrections_used or 0)
    unused = now.corrections_unused - (before.corrections_unused or 0)
    is_whole = used >= 0 and unused >= 0 and used + unused > 0
    return round(used / (used + unused), 2) if is_whole else None


def _choose_shown(satellites: tuple[Satellite, ...]) -> list[wire.SeenSatellite]:
    """Choose the satellites that are shown, in the order of the receiver."""
    best = sorted(satellites, key=lambda each: (not each.is_used, -each.snr_db))[:MOST_SHOWN]
    chosen = {(each.system, each.number) for each in best}
    return [
        wire.SeenSatellite(
            system=each.system,
            number=each.number,
            elevation_deg=round(each.elevation_deg),
            azimuth_deg=round(each.azimuth_deg),
            snr_db=round(each.snr_db),
            is_used=each.is_used,
        )
        for each in satellites
        if (each.system, each.number) in chosen
    ]


def _round_dop(value: float | None) -> float | None:
    return None if value is None else round(value, 1)


def _shorten(std_m: float) -> float | None:
    return round(std_m, 4) if 0.0 <= std_m < float("inf") else None
