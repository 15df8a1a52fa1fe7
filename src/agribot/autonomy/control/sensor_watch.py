"""Do clock, wheel encoders and IMU speak, and do they speak in numbers? How is the robot tilted?"""

from __future__ import annotations

import math
from collections import deque

from agribot.core.arithmetic import clamp
from agribot.core.config import SafetyConfig
from agribot.core.facts import (
    ClockJumped,
    ClockStands,
    ClockUnreadable,
    ClockWentBack,
    Fact,
    ImuLineSpoilt,
    ImuSpoilt,
    NotHeardYet,
    SensorNotFinite,
    SensorSilent,
    Tilted,
    TiltUnknown,
    Unspoken,
)
from agribot.core.messages import ImuSample, SensorBatch, Vec3

TILT_FILTER_S = 0.5  # driving over clods shakes the accelerometer; a fall lasts longer
MAX_DT_S = 0.1
FROZEN_TICKS = 5  # ticks at the same time: a clock that stands
# Beyond the range of such sensors: a number corrupted on its way. A single one is left out and
# reported; several within seconds are a line that is not fit to drive with.
MAX_ACCEL_MPS2, MAX_GYRO_RADPS = 160.0, 40.0
SPOILT_S, SPOILT_COUNT = 5.0, 3


class SensorWatch:
    """Listens to every batch; each question is answered by a fact, None where all is well."""

    def __init__(self, config: SafetyConfig) -> None:
        self._config = config
        self._t_s = math.nan
        self._frozen_ticks = 0
        self._wheel_t_s = self._imu_t_s = -math.inf
        self._wheels_rad = 0.0
        self._up, self._has_tilt = (0.0, 0.0, 0.0), True
        self._spoilt_s: deque[float] = deque(maxlen=SPOILT_COUNT)
        self._spoilt = 0.0
        self.dt_s = 0.0
        self.clock_fault: Fact | None = None

    def update(self, batch: SensorBatch) -> None:
        self._read_clock(batch.t_s)
        if batch.wheels:
            self._wheel_t_s = batch.wheels[-1].t_s
            self._wheels_rad = sum(batch.wheels[-1].angle_rad)
        for sample in batch.imu:
            accel_mps2 = sample.accel_mps2
            if not self._is_spoilt(sample) and accel_mps2 is not None:
                self._up = self._smooth(accel_mps2, sample.t_s - self._imu_t_s)
            self._imu_t_s, self._has_tilt = sample.t_s, accel_mps2 is not None
        if self._spoilt_s and not 0.0 <= batch.t_s - self._spoilt_s[-1] <= SPOILT_S:
            self._spoilt_s.clear()

    @property
    def tilt_rad(self) -> float:
        x, y, z = self._up
        return math.atan2(math.hypot(x, y), z)

    def unheard(self) -> NotHeardYet | None:
        """Find a sensor that never spoke, as before the robot is ready."""
        unheard = (name for name, heard_s in self._last_times_s() if heard_s == -math.inf)
        return next((NotHeardYet(name) for name in unheard), None)

    def silence(self, t_s: float) -> Fact | None:
        """Find a sensor that spoke and does not any more, or not in numbers."""
        limit_s = self._config.sensor_timeout_s
        for name, heard_s in self._last_times_s():
            silent_s = t_s - heard_s
            if heard_s != -math.inf and not silent_s <= limit_s:
                return SensorSilent(name, silent_s, limit_s, "cable")
        if not math.isfinite(sum(self._up)):
            return SensorNotFinite("imu")
        return None if math.isfinite(self._wheels_rad) else SensorNotFinite("wheels")

    def tilt(self) -> Tilted | None:
        tilt_rad, limit_rad = self.tilt_rad, self._config.max_tilt_rad
        is_level = tilt_rad <= limit_rad or not self._has_tilt
        return None if is_level else Tilted(tilt_rad, limit_rad)

    def unknown_tilt(self) -> TiltUnknown | None:
        """Find that the IMU does not measure how the robot is tilted."""
        return None if self._has_tilt else TiltUnknown()

    def spoilt_number(self) -> ImuSpoilt | None:
        """Find a number of the IMU that cannot be, for some seconds."""
        return ImuSpoilt(self._spoilt) if self._spoilt_s else None

    def spoilt_line(self) -> ImuLineSpoilt | None:
        """Find a line with too many corrupted samples to be trusted."""
        times_s = self._spoilt_s
        if len(times_s) < SPOILT_COUNT or times_s[-1] - times_s[0] > SPOILT_S:
            return None
        return ImuLineSpoilt(SPOILT_COUNT, times_s[-1] - times_s[0], SPOILT_S)

    def _is_spoilt(self, sample: ImuSample) -> bool:
        """Whether a finite number is beyond the range of any such sensor."""
        accel = max(map(abs, sample.accel_mps2 or (0.0,)))
        gyro = max(map(abs, sample.gyro_radps))
        if not (MAX_ACCEL_MPS2 < accel < math.inf or MAX_GYRO_RADPS < gyro < math.inf):
            return False
        self._spoilt = accel if accel > MAX_ACCEL_MPS2 else gyro
        self._spoilt_s.append(sample.t_s)
        return True

    def _last_times_s(self) -> tuple[tuple[Unspoken, float], tuple[Unspoken, float]]:
        return ("wheels", self._wheel_t_s), ("imu", self._imu_t_s)

    def _read_clock(self, t_s: float) -> None:
        dt_s, limit_s = t_s - self._t_s, self._config.clock_jump_s
        self._frozen_ticks = self._frozen_ticks + 1 if dt_s == 0.0 else 0
        self.clock_fault = self._judge_clock(t_s, dt_s, limit_s)
        self.dt_s = clamp(dt_s, 0.0, MAX_DT_S) if math.isfinite(dt_s) else 0.0
        if math.isfinite(t_s):
            self._t_s = t_s
            # A time stamp in the future counts as now.
            self._wheel_t_s, self._imu_t_s = min(self._wheel_t_s, t_s), min(self._imu_t_s, t_s)

    def _judge_clock(self, t_s: float, dt_s: float, limit_s: float) -> Fact | None:
        if not math.isfinite(t_s):
            return ClockUnreadable(t_s)
        if dt_s < 0.0:
            return ClockWentBack(-dt_s)
        if dt_s > limit_s:
            return ClockJumped(dt_s, limit_s)
        return ClockStands(t_s) if self._frozen_ticks >= FROZEN_TICKS else None

    def _smooth(self, accel_mps2: Vec3, dt_s: float) -> Vec3:
        """Low pass of the specific force; one that was lost to a bad value starts afresh."""
        x, y, z = self._up
        if not math.isfinite(x + y + z) or not math.isfinite(dt_s):
            return accel_mps2
        gain = min(max(dt_s, 0.0) / TILT_FILTER_S, 1.0)
        ax, ay, az = accel_mps2
        return (x + gain * (ax - x), y + gain * (ay - y), z + gain * (az - z))
