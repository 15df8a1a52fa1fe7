"""The verdicts on the sensors: who is not believed, since when, and why."""

from __future__ import annotations

from collections.abc import Iterable

from agribot.autonomy.estimate.witnesses.witness import Finding
from agribot.core.fact_text import render
from agribot.core.messages import FINE, SensorVerdict, SensorVerdicts

SILENT_S = 3.0  # silence after which GNSS and compass count as silent


class VerdictTable:
    """Remembers since when a sensor is what it is; of two findings on one the first counts."""

    def __init__(self) -> None:
        self._table: SensorVerdicts = {}

    def judge(self, t_s: float, findings: Iterable[Finding]) -> SensorVerdicts:
        found: SensorVerdicts = {}
        for sensor, state, fact, _ in findings:
            if sensor not in found:
                before = self._table.get(sensor, FINE)
                since_s = before.since_s if before.state == state else t_s
                found[sensor] = SensorVerdict(
                    state=state, since_s=since_s, reason=render(fact), fact=fact
                )
        self._table = found
        return found
