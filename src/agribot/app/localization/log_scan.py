"""First pass over a log: times, units, mounting, and where it begins."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from agribot.app.localization.fix_ways import FixWays, WheelWay
from agribot.app.localization.imu_mount import ImuMountFit
from agribot.app.localization.log import LogEntry, LogSensor, RobotLog, TwistSample
from agribot.app.localization.time_order import order_by_stamp
from agribot.core.messages import GnssFix, GnssQuality, ImuSample, Vec3, WheelSample
from agribot.core.robot import DriveSpec

# IMU and wheels are compared over pieces of this length, s; longer ones than the second are gaps.
PIECE_S, LONGEST_PIECE_S = 0.1, 1.0
GAIN_STD_RATIO = 0.05  # 1 sigma of a gain that is known
REPORT_EVERY = 1000  # entries, of progress
STANDING_MPS, STANDING_RADPS = 1e-3, 1e-3


class SensorScan:
    """Times of the messages of one sensor."""

    def __init__(self) -> None:
        self.count = self.samples = self.backwards = 0
        self.first_s, self.last_s = math.inf, -math.inf
        self.worst_back_s = self.worst_back_at_s = 0.0
        self.longest_gap_s = 0.0
        self.frames: Counter[str] = Counter()
        self._before_s = -math.inf
        self._delays_s = 0.0

    @property
    def delay_s(self) -> float:
        """Mean time from a stamp until it was logged."""
        return self._delays_s / max(self.count, 1)

    def add(self, entry: LogEntry) -> None:
        stamp_s = entry.stamp_s
        self.count += 1
        self._delays_s += entry.logged_s - stamp_s
        self.samples += entry.sample is not None
        step_s = stamp_s - self._before_s
        if step_s < 0.0:
            self.backwards += 1
            if -step_s > self.worst_back_s:
                self.worst_back_s, self.worst_back_at_s = -step_s, stamp_s
        elif math.isfinite(step_s):
            self.longest_gap_s = max(self.longest_gap_s, step_s)
        self._before_s = stamp_s
        self.first_s, self.last_s = min(self.first_s, stamp_s), max(self.last_s, stamp_s)
        if entry.sample is not None:
            self.frames[entry.frame] += 1


class LogScan:
    """Results of one pass over a log."""

    def __init__(self, drive: DriveSpec) -> None:
        self._drive = drive
        self.sensors: dict[LogSensor, SensorScan] = {}
        self.mount = ImuMountFit()
        self.has_wheels = False  # their turns are reported, not the robot's speed
        self.most_mps = self.most_radps = self.most_gyro_radps = self.driven_m = 0.0
        self._pieces = _Pieces(self.mount)
        self._way = WheelWay()
        self._ways: dict[str, FixWays] = {}  # ways by the frame of the receiver

    @property
    def start_s(self) -> float:
        """The first stamp of all sensors; times of a run count from it."""
        return min((scan.first_s for scan in self.sensors.values()), default=0.0)

    @property
    def end_s(self) -> float:
        return max((scan.last_s for scan in self.sensors.values()), default=0.0)

    def main_frame(self, sensor: LogSensor) -> str:
        """Find the frame of most of a sensor's samples."""
        frames = self.sensors[sensor].frames if sensor in self.sensors else Counter[str]()
        return max(frames, key=lambda name: (frames[name], name), default="")

    def note(self, entry: LogEntry) -> None:
        """Note the times of a message, in the order of the log."""
        self.sensors.setdefault(entry.sensor, SensorScan()).add(entry)

    def add(self, entry: LogEntry) -> None:
        """Add a sample, in the order of the stamps."""
        sample = entry.sample
        if isinstance(sample, GnssFix) and sample.quality is not GnssQuality.NONE:
            if entry.frame not in self._ways:
                self._ways[entry.frame] = FixWays(sample)
            self._ways[entry.frame].add(entry.stamp_s, sample, self._way.place_m)
        elif isinstance(sample, ImuSample):
            self.most_gyro_radps = max(self.most_gyro_radps, *map(abs, sample.gyro_radps))
            # Without accelerations it shows no more of its mount than one that takes off gravity.
            self._pieces.add_imu(sample.gyro_radps, sample.accel_mps2 or (0.0, 0.0, 0.0))
        elif isinstance(sample, WheelSample | TwistSample):
            self.has_wheels = isinstance(sample, WheelSample)
            v_mps, yaw_radps = find_twist(sample, self._drive)
            self.most_mps = max(self.most_mps, abs(v_mps))
            self.most_radps = max(self.most_radps, abs(yaw_radps))
            self.driven_m += self._pieces.add_twist(entry.stamp_s, v_mps, yaw_radps)
            self._way.add(entry.stamp_s, v_mps, yaw_radps)

    @property
    def turn_gain(self) -> float | None:
        """Turn of the gyro over that of the wheels; None of too few turns."""
        slope, std = self.mount.fit_turns()
        gain = float(np.linalg.norm(slope))
        return gain if std < GAIN_STD_RATIO * gain else None

    @property
    def way_ratio(self) -> float | None:
        """Way of the wheels over that of the fixes; None of too short a way."""
        ways = self._ways.get(self.main_frame("gnss"))
        return None if ways is None else ways.ratio

    @property
    def turn_agreement(self) -> float:
        """Agreement of turns by fixes and by wheels: 1 fully, -1 they are mirrored, 0 unknown."""
        ways = self._ways.get(self.main_frame("gnss"))
        return 0.0 if ways is None else ways.turn_agreement

    @property
    def first_fix(self) -> GnssFix | None:
        """The first fix of the receiver that is used."""
        ways = self._ways.get(self.main_frame("gnss"))
        return None if ways is None else ways.first


def find_twist(sample: WheelSample | TwistSample, drive: DriveSpec) -> tuple[float, float]:
    """Find speed (m/s) and yaw rate (rad/s) of the wheels."""
    if isinstance(sample, TwistSample):
        return sample.v_mps, sample.yaw_rate_radps
    rear_right, rear_left, front_right, front_left = sample.speed_radps
    right_mps = drive.wheel_radius_m * (rear_right + front_right) / 2.0
    left_mps = drive.wheel_radius_m * (rear_left + front_left) / 2.0
    return (right_mps + left_mps) / 2.0, (right_mps - left_mps) / drive.effective_separation_m


class _Pieces:
    """Means of IMU and wheels over short pieces of time."""

    def __init__(self, fit: ImuMountFit) -> None:
        self._fit = fit
        self._gyro, self._accel = np.zeros(3), np.zeros(3)
        self._count = 0
        self._begin: tuple[float, float] | None = None  # time and speed
        self._last_s = -math.inf
        self._turned_rad = self._driven_m = 0.0

    def add_imu(self, gyro_radps: Vec3, accel_mps2: Vec3) -> None:
        self._gyro += gyro_radps
        self._accel += accel_mps2
        self._count += 1

    def add_twist(self, t_s: float, v_mps: float, yaw_radps: float) -> float:
        """Add a reading of the wheels; return the way since the last one, m."""
        dt_s = t_s - self._last_s
        self._last_s = t_s
        if self._begin is None or not 0.0 < dt_s < LONGEST_PIECE_S:
            self._restart(t_s, v_mps)
            return 0.0
        self._turned_rad += yaw_radps * dt_s
        self._driven_m += v_mps * dt_s
        passed_s = t_s - self._begin[0]
        if passed_s >= PIECE_S - 1e-3 and self._count:
            self._finish(passed_s, v_mps)
            self._restart(t_s, v_mps)
        return abs(v_mps) * dt_s

    def _finish(self, passed_s: float, v_mps: float) -> None:
        assert self._begin is not None
        mean_mps, yaw_radps = self._driven_m / passed_s, self._turned_rad / passed_s
        ahead_mps2 = (v_mps - self._begin[1]) / passed_s
        if abs(mean_mps) < STANDING_MPS and abs(yaw_radps) < STANDING_RADPS:
            mean_mps = ahead_mps2 = yaw_radps = 0.0
        gyro, accel = self._gyro / self._count, self._accel / self._count
        self._fit.add(tuple(gyro), tuple(accel), mean_mps, ahead_mps2, yaw_radps)

    def _restart(self, t_s: float, v_mps: float) -> None:
        self._begin = t_s, v_mps
        self._gyro, self._accel = np.zeros(3), np.zeros(3)
        self._count, self._turned_rad, self._driven_m = 0, 0.0, 0.0


def scan_log(
    log: RobotLog, drive: DriveSpec, on_progress: Callable[[int], None] = lambda count: None
) -> LogScan:
    """Read the whole log once; memory does not grow with it."""
    scan = LogScan(drive)

    def note_all() -> Iterator[LogEntry]:
        for entry in log.entries():
            scan.note(entry)
            yield entry

    for entry in order_by_stamp(count_entries(note_all(), on_progress)):
        scan.add(entry)
    return scan


def count_entries(
    entries: Iterable[LogEntry], on_progress: Callable[[int], None]
) -> Iterator[LogEntry]:
    """Pass entries on, and report how many came."""
    count = 0
    for count, entry in enumerate(entries, 1):
        if count % REPORT_EVERY == 0:
            on_progress(count)
        yield entry
    on_progress(count)
