"""Simulated time: whole nanoseconds, whole physics steps."""

from __future__ import annotations

from fractions import Fraction

from agribot.core.errors import ConfigError

NS_PER_S = 1_000_000_000


def round_step_ns(step_s: float) -> int:
    """Return the physics step in whole nanoseconds."""
    return round(step_s * NS_PER_S)


class Schedule:
    """The physics steps on which a sensor samples.

    Sample `k` (1, 2, ...) falls on the first physics step at or after `k / rate`. Exact for any
    rate: 30 Hz on a 2 ms grid neither drifts nor drops a sample.
    """

    def __init__(self, rate_hz: float, physics_step_ns: int) -> None:
        if rate_hz <= 0.0:
            raise ConfigError(f"sample rate {rate_hz} Hz; it must be above zero")
        period = Fraction(NS_PER_S, physics_step_ns) / Fraction(str(rate_hz))
        if period < 1:
            limit_hz = NS_PER_S / physics_step_ns
            raise ConfigError(
                f"sample rate {rate_hz} Hz is above the {limit_hz:g} Hz of the physics; "
                "lower the rate or sim.step_s"
            )
        self._numerator = period.numerator
        self._denominator = period.denominator
        self._next = 1
        self.next_step = self._step(1)

    def _step(self, sample: int) -> int:
        return -(-sample * self._numerator // self._denominator)

    def pop(self) -> int:
        """Return the step of the next sample and go on to the one after it."""
        step = self.next_step
        self._next += 1
        self.next_step = self._step(self._next)
        return step

    def pop_due(self, last_step: int) -> list[int]:
        """Return the steps of the samples up to and including `last_step`, each only once."""
        steps: list[int] = []
        while self.next_step <= last_step:
            steps.append(self.pop())
        return steps
