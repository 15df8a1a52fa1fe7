"""The verdicts on the sensors: who is not believed, since when, and why."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

from agribot.core.fact_text import render
from agribot.core.facts import Fact
from agribot.core.messages import ALL_FINE, FINE, SensorState, SensorVerdict, SensorVerdicts

SensorName = Literal["gnss", "compass", "gyro", "wheels", "camera", "clock"]
SILENT_S = 3.0  # silence after which GNSS and compass count as silent


class Finding(NamedTuple):
    """Something that speaks against a sensor at this moment."""

    sensor: SensorName
    state: SensorState
    fact: Fact


class VerdictTable:
    """Remembers since when a sensor is what it is; of two findings on one the first counts."""

    def __init__(self) -> None:
        self._table = ALL_FINE

    def judge(self, t_s: float, findings: Iterable[Finding]) -> SensorVerdicts:
        found: dict[str, SensorVerdict] = {}
        for sensor, state, fact in findings:
            if sensor not in found:
                before: SensorVerdict = getattr(self._table, sensor)
                since_s = before.since_s if before.state == state else t_s
                found[sensor] = SensorVerdict(
                    state=state, since_s=since_s, reason=render(fact), fact=fact
                )
        if found or self._table is not ALL_FINE:
            # The very struct FINE, which takes no room in a recording.
            verdicts = {name: found.get(name, FINE) for name in SensorVerdicts.__struct_fields__}
            self._table = SensorVerdicts(**verdicts) if found else ALL_FINE
        return self._table
