"""How much is left in the battery: enough, little enough to go home, or too little to drive."""

from __future__ import annotations

import math

from agribot.core.config import SafetyConfig
from agribot.core.facts import BatteryEmpty, BatteryLow
from agribot.core.messages import BatterySample, SensorBatch

LASTING_S = 5.0  # a voltage sags while the motors start


class BatteryWatch:
    """`low` and `empty` are the faults; both are None while the charge is enough.

    Without a state of charge, the voltage counts if the settings give its limits. A robot that
    reports no battery is never held.
    """

    def __init__(self, config: SafetyConfig) -> None:
        self._config = config
        self._low_since_s = self._empty_since_s = math.inf
        self.low: BatteryLow | None = None
        self.empty: BatteryEmpty | None = None

    def update(self, batch: SensorBatch) -> None:
        for sample in batch.battery:
            self._evaluate(sample)

    def _evaluate(self, sample: BatterySample) -> None:
        config, t_s = self._config, sample.t_s
        value, is_charge = 100.0 * sample.charge_ratio, True
        low, empty = 100.0 * config.low_charge_ratio, 100.0 * config.empty_charge_ratio
        if not math.isfinite(value):
            value, is_charge = sample.voltage_v, False
            low, empty = config.low_battery_v, config.empty_battery_v
        self._low_since_s = min(self._low_since_s, t_s) if value < low else math.inf
        self._empty_since_s = min(self._empty_since_s, t_s) if value < empty else math.inf
        low_s, empty_s = t_s - self._low_since_s, t_s - self._empty_since_s
        none = (None, None)
        lows = (value, low, *none) if is_charge else (*none, value, low)
        empties = (value, empty, *none) if is_charge else (*none, value, empty)
        self.low = BatteryLow(*lows) if low_s >= LASTING_S else None
        self.empty = BatteryEmpty(*empties) if empty_s >= LASTING_S else None
