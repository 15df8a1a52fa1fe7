"""What the motor board's safety inputs say, and whether those that must be there still speak."""

from __future__ import annotations

import math

from agribot.core.config import SafetyConfig
from agribot.core.messages import BoardSample, SafetyInput, SensorBatch

BATTERY_AGE_S = 5.0  # its voltage tells nothing of a fault of the last moments
# A board that holds a stop may do so for this long after a person cleared it: it is told, and lets
# go. One that had let go holds a new one.
CLEARING_S = 3.0


class InputWatch:
    """Listens to every batch; each question is answered in words, empty where all is well."""

    def __init__(self, config: SafetyConfig) -> None:
        self._must = config.must_report or ()
        self._timeout_s = config.sensor_timeout_s
        self._heard_s: dict[SafetyInput, float] = {}
        self._last: BoardSample | None = None
        self._t_s, self._cleared_s = 0.0, -math.inf
        self.fault = ""

    def update(self, batch: SensorBatch) -> None:
        t_s = self._t_s = batch.t_s
        # What was heard in a future that is none was heard now at the latest.
        self._heard_s = {name: min(heard_s, t_s) for name, heard_s in self._heard_s.items()}
        faults: dict[str, None] = {}
        for sample in batch.board:
            self._heard_s.update(dict.fromkeys(sample.inputs, sample.t_s))
            faults.update(dict.fromkeys(sample.faults))
            self._last = sample
            if not sample.stopped:
                self._cleared_s = -math.inf
        if batch.board:
            self.fault = f"motor board: {'; '.join(faults)}" if faults else ""

    @property
    def is_there(self) -> bool:
        """Whether a motor board tells of safety inputs, or has to."""
        return bool(self._must) or self._last is not None

    def accept(self, t_s: float) -> None:
        """Let the board's own stop go: a person has cleared it, and the board is told."""
        self._cleared_s = t_s

    def button(self) -> str:
        """Tell of the red button."""
        is_pressed = self._last is not None and self._last.is_button_pressed
        return "the red button is pressed; release it when all is clear" if is_pressed else ""

    def stop(self) -> str:
        """Tell of the stop that the board holds, unless it is being cleared."""
        last = self._last
        if (
            last is not None
            and last.stopped
            and not 0.0 <= self._t_s - self._cleared_s <= CLEARING_S
        ):
            return f"the motor board holds a stop: {last.stopped}"
        return ""

    def unheard(self) -> str:
        """Name an input that must be there and never spoke."""
        for name in self._must:
            if name not in self._heard_s:
                return f"the {name} has not been reported yet; check the motor board"
        return ""

    def silence(self) -> str:
        """Name an input that must be there, spoke and does not any more."""
        for name in self._must:
            limit_s = BATTERY_AGE_S if name == "battery" else self._timeout_s
            silent_s = self._t_s - self._heard_s.get(name, self._t_s)
            if not silent_s <= limit_s:
                return (
                    f"the {name} is not reported for {silent_s:.2f} s > {limit_s:.2f} s; check "
                    "the motor board"
                )
        return ""
