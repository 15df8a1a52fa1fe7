"""Is the robot really standing? Measured by wheels and gyro, never taken from the command."""

from __future__ import annotations

# Judged over windows of this length; a stop ramp or a creep shows within one.
WINDOW_S = 0.5
MAX_TRAVEL_M = 0.002
# Rate above any turn-on bias of a gyro, far below any turn that a wheel could miss.
MAX_RATE_RADPS = 0.05
# Bias wander inside a window and gyro quantisation keep the mean from being exact.
FLOOR_STD_RADPS = 2e-4


class Standstill:
    """Watches for quiet wheels and a quiet gyro; each quiet window measures the gyro's bias."""

    def __init__(self) -> None:
        self.is_still = False
        self._travels_m = [0.0] * 4
        self._age_s = self._sum = self._square_sum = 0.0
        self._count = 0

    def update(
        self, dt_s: float, travels_m: tuple[float, ...], rate_radps: float
    ) -> tuple[float, float] | None:
        """Take one step of the four wheels and the gyro.

        Returns: mean rate and its variance, once per quiet window.
        """
        self._travels_m = [a + b for a, b in zip(self._travels_m, travels_m, strict=True)]
        too_far = max(map(abs, self._travels_m)) > MAX_TRAVEL_M
        if too_far or abs(rate_radps) > MAX_RATE_RADPS:
            self.is_still = False
            self._restart()
            return None
        self._age_s += dt_s
        self._count += 1
        self._sum += rate_radps
        self._square_sum += rate_radps * rate_radps
        if self._age_s < WINDOW_S:
            return None
        mean = self._sum / self._count
        spread = max(self._square_sum / self._count - mean * mean, 0.0)
        variance = spread / self._count + FLOOR_STD_RADPS**2
        self.is_still = True
        self._restart()
        return mean, variance

    def _restart(self) -> None:
        self._travels_m = [0.0] * 4
        self._age_s = self._sum = self._square_sum = 0.0
        self._count = 0
