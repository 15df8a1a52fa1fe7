"""What the motor board's safety inputs say, and whether those that must be there still speak."""

from __future__ import annotations

import math

from agribot.core.config import SafetyConfig
from agribot.core.facts import (
    AnyFact,
    BoardHoldsStop,
    BoardReports,
    ButtonPressed,
    InputNotHeardYet,
    InputSilent,
    join_facts,
)
from agribot.core.messages import BoardSample, SafetyInput, SensorBatch

# Timeout of the battery's voltage, which does not show faults of the last moments.
BATTERY_AGE_S = 5.0
# Time after a clear command in which the board may still hold its stop. A board that had released
# its stop holds a new one.
CLEARING_S = 3.0


class InputWatch:
    """Listens to every batch; each question is answered by a fact, None where all is well."""

    def __init__(self, config: SafetyConfig) -> None:
        self._must = config.must_report or ()
        self._timeout_s = config.sensor_timeout_s
        self._heard_s: dict[SafetyInput, float] = {}
        self._last: BoardSample | None = None
        self._t_s, self._cleared_s = 0.0, -math.inf
        self.fault: BoardReports | None = None

    def update(self, batch: SensorBatch) -> None:
        t_s = self._t_s = batch.t_s
        # A time stamp in the future counts as now.
        self._heard_s = {name: min(heard_s, t_s) for name, heard_s in self._heard_s.items()}
        faults: list[AnyFact] = []
        for sample in batch.board:
            self._heard_s.update(dict.fromkeys(sample.inputs, sample.t_s))
            if sample.fault is not None and sample.fault not in faults:
                faults.append(sample.fault)
            self._last = sample
            if sample.stop is None:
                self._cleared_s = -math.inf
        if batch.board:
            cause = join_facts(faults)
            self.fault = None if cause is None else BoardReports(cause=cause)

    @property
    def is_there(self) -> bool:
        """Whether a motor board reports safety inputs, or must."""
        return bool(self._must) or self._last is not None

    def accept(self, t_s: float) -> None:
        """Accept that a person cleared the board's own stop; the board gets the command."""
        self._cleared_s = t_s

    def button(self) -> ButtonPressed | None:
        """Find the red button pressed."""
        is_pressed = self._last is not None and self._last.is_button_pressed
        return ButtonPressed() if is_pressed else None

    def stop(self) -> BoardHoldsStop | None:
        """Find the stop that the board holds, unless it is being cleared."""
        last = self._last
        if last is None or last.stop is None or 0.0 <= self._t_s - self._cleared_s <= CLEARING_S:
            return None
        return BoardHoldsStop(cause=last.stop)

    def unheard(self) -> InputNotHeardYet | None:
        """Find an input that must be there and never spoke."""
        unheard = (name for name in self._must if name not in self._heard_s)
        return next((InputNotHeardYet(name) for name in unheard), None)

    def silence(self) -> InputSilent | None:
        """Find an input that must be there, spoke and does not any more."""
        for name in self._must:
            limit_s = BATTERY_AGE_S if name == "battery" else self._timeout_s
            silent_s = self._t_s - self._heard_s.get(name, self._t_s)
            if not silent_s <= limit_s:
                return InputSilent(name, silent_s, limit_s)
        return None
