"""What `agribot doctor` reads in the last reports: parts that fall silent for moments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from agribot.cli.doctor.doctor_findings import CheckResult
from agribot.core.facts import ComingAndGoing
from agribot.record.dropout_watch import MANY, Dropouts

RUNS = Path("runs")
LAST = 5  # runs that are compared
WHAT = "short dropouts"


class _Safety(msgspec.Struct):
    dropouts: dict[ComingAndGoing, Dropouts] | None = None


class _Report(msgspec.Struct):
    """The one part of a report that is read here."""

    safety: _Safety = msgspec.field(default_factory=_Safety)


def check_dropouts(runs: Path = RUNS) -> Iterator[CheckResult]:
    """Compare the dropouts of the last runs whose reports count them; nothing without such runs."""
    counted = list(_read_last(runs))
    if not counted:
        return
    parts = dict.fromkeys(part for dropouts in counted for part in dropouts)
    within = f"in the last {len(counted)} runs of {runs}"
    if not parts:
        yield CheckResult(what=WHAT, state="ok", detail=f"none {within}")
    for part in parts:
        yield _compare(part, [dropouts.get(part) for dropouts in counted], within)


def _compare(part: ComingAndGoing, runs: Sequence[Dropouts | None], within: str) -> CheckResult:
    """Report one part: dropouts per hour, the newest run last."""
    rates = [0.0 if one is None else one.per_hour for one in runs]
    newest = runs[-1]
    is_many = newest is not None and newest.count >= MANY
    trend = ", ".join(f"{rate:.0f}" for rate in rates)
    advice = "; check its plug and cable" if is_many else ""
    detail = f"{trend} an hour {within}, the newest last{advice}"
    return CheckResult(
        what=f"{WHAT} of {part}", state="warning" if is_many else "ok", detail=detail
    )


def _read_last(runs: Path) -> Iterator[dict[ComingAndGoing, Dropouts]]:
    """Read the last reports that count dropouts, the oldest first; others are left out."""
    found = sorted(runs.glob("*/report.json"), key=lambda path: path.stat().st_mtime)
    for path in found[-LAST:]:
        try:
            report = msgspec.json.decode(path.read_bytes(), type=_Report)
        except (OSError, msgspec.MsgspecError):
            continue
        if report.safety.dropouts is not None:
            yield report.safety.dropouts
