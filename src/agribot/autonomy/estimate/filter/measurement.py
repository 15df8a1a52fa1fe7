"""What a sensor measured, as the filter takes it: residuals, their rows and their noise."""

from __future__ import annotations

from typing import NamedTuple

from agribot.autonomy.estimate.filter.ekf import Row
from agribot.autonomy.estimate.filter.gate import Gate
from agribot.autonomy.estimate.filter.row_model import tail_factor


class Measurement(NamedTuple):
    """One or two residuals, measured less expected, of equal and independent noise.

    `rows` are the derivatives of the expected values by the state, `variance` is the residuals'
    own. `opens` are the states, with the variances to add, that a measurement blames once a run of
    its kind was rejected; `is_retaken`: it is then taken itself.
    """

    residuals: tuple[float, ...]
    rows: tuple[Row, ...]
    variance: float
    gate: Gate | None = None  # without one it opens and is taken unchecked
    opens: tuple[tuple[int, float], ...] = ()
    is_retaken: bool = True
    # Something else says that the state is wrong: the filter opens, whatever the gate says.
    must_open: bool = False
    # Variance of errors that last longer than a sample: residuals are judged without, and taken
    # with it.
    lasting_variance: float | None = None
    # Whether an accepted sample counts less the more it looks like an outlier.
    has_tails: bool = False

    @property
    def is_judged_first(self) -> bool:
        """Whether its distance from the state decides by how much it is taken, row by row."""
        return self.has_tails or self.lasting_variance is not None

    def taken_variance(self, distance2: float) -> float:
        variance = self.variance if self.lasting_variance is None else self.lasting_variance
        return variance * tail_factor(distance2) if self.has_tails else variance
