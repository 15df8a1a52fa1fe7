"""What is wrong with a log, in words: sensors that lack, times, units, mounting."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from agribot.app.localization.imu_mount import GRAVITY_MPS2, LEAST_GRAVITY_MPS2, SURE_RAD
from agribot.app.localization.log import LogSensor, RobotLog
from agribot.app.localization.log_scan import LogScan, SensorScan
from agribot.core.errors import RecordingError

NEEDED: dict[LogSensor, str] = {
    "odom": "odometry: Odometry, TwistStamped or JointState; the wheels carry the pose",
    "imu": "IMU: sensor_msgs/Imu; its gyro carries the heading",
    "gnss": "GNSS: NavSatFix, GPSFix, NMEA or UBX; fixes give the position",
}
# Stamps may stand in another order than the log now and then, no more often, and no farther back.
MOST_BACKWARDS_RATIO, MOST_BACK_S = 0.01, 2.0
MOST_CLOCK_OFF_S = 1.0  # offset of two sensors' stamps against the recorder's clock
DEGREES_PER_RAD = 180.0 / math.pi
# Range of a ratio that should be one; no wrong unit reaches it.
LEAST_RATIO, MOST_RATIO = 0.4, 2.5
MIRRORED = -0.5  # agreement of turns below which wheels and fixes are mirrored
MOST_RADPS = 40.0  # the range of gyros ends at 2000 degrees a second
_FACTORS = {1e-3: "km", 1e3: "mm", 1e2: "cm", 3.6: "km/h", 1.0 / 0.3048: "feet"}
# Least ratio of degrees. A degree of longitude is shorter than one of latitude, as a robot drives
# both.
LEAST_RADIANS_RATIO = 0.2 * DEGREES_PER_RAD


def check_scan(log: RobotLog, scan: LogScan) -> list[str]:
    """Refuse a log that no pose can be made of; return notes on the rest.

    Raises: RecordingError: a sensor lacks, times go back, or a unit is wrong.
    """
    _check_sensors(log, scan)
    for sensor, times in scan.sensors.items():
        _check_times(_name(log, sensor), times)
    _check_overlap(log, scan)
    _check_clocks(log, scan)
    _check_gyro(log, scan)
    _check_accel(log, scan)
    _check_way(log, scan)
    _check_sides(log, scan)
    return list(_list_notes(log, scan))


def _name(log: RobotLog, sensor: LogSensor) -> str:
    sources = [each.source for each in log.channels if each.sensor == sensor]
    return f"{sensor} ({sources[0]})" if sources else sensor


def _check_sensors(log: RobotLog, scan: LogScan) -> None:
    notes = f" ({'; '.join(log.notes[:2])})" if log.notes else ""
    for sensor, needs in NEEDED.items():
        times = scan.sensors.get(sensor)
        if times is None:
            raise RecordingError(
                f"the log has no {needs}; name a topic or a file with --{sensor}{notes}"
            )
        if not times.samples:
            what = "has a position" if sensor == "gnss" else "can be used"
            raise RecordingError(
                f"{_name(log, sensor)}: none of {times.count} messages {what}; check the "
                f"{'receiver and its antenna' if sensor == 'gnss' else 'sensor'}{notes}"
            )


def _check_times(name: str, times: SensorScan) -> None:
    often = times.backwards > MOST_BACKWARDS_RATIO * times.count
    if times.count > 1 and times.backwards >= 0.9 * (times.count - 1):
        raise RecordingError(
            f"{name}: times run backwards, from {times.last_s:.3f} to {times.first_s:.3f} s; the "
            "log was played or written from its end; record it again, or try --stamps log"
        )
    if often or times.worst_back_s > MOST_BACK_S:
        raise RecordingError(
            f"{name}: times go back {times.backwards} times in {times.count} messages, by "
            f"{times.worst_back_s:.3f} s at {times.worst_back_at_s:.3f}; cut the log there, or "
            "take the recorder's times with --stamps log"
        )


def _check_overlap(log: RobotLog, scan: LogScan) -> None:
    begin_s = max(scan.sensors[sensor].first_s for sensor in NEEDED)
    end_s = min(scan.sensors[sensor].last_s for sensor in NEEDED)
    if begin_s < end_s:
        return
    spans = ", ".join(
        f"{_name(log, sensor)} {scan.sensors[sensor].first_s:.1f} to "
        f"{scan.sensors[sensor].last_s:.1f} s"
        for sensor in NEEDED
    )
    raise RecordingError(
        f"the sensors have no time in common: {spans}; write the same clock into all files"
    )


def _check_clocks(log: RobotLog, scan: LogScan) -> None:
    wheels = scan.sensors["odom"]
    for sensor in ("imu", "gnss"):
        off_s = wheels.delay_s - scan.sensors[sensor].delay_s
        if abs(off_s) > MOST_CLOCK_OFF_S:
            raise RecordingError(
                f"{_name(log, sensor)}: its stamps are {off_s:+.2f} s off those of the wheels, by "
                "the recorder's clock; set the clocks of both computers, or take the recorder's "
                "times with --stamps log"
            )


def _check_gyro(log: RobotLog, scan: LogScan) -> None:
    slope, std = scan.mount.fit_turns()
    gain = float(np.linalg.norm(slope))
    has_turned = gain > 0.0 and std / gain < SURE_RAD
    too_fast = DEGREES_PER_RAD * LEAST_RATIO < gain < DEGREES_PER_RAD * MOST_RATIO
    too_slow = LEAST_RATIO < gain * DEGREES_PER_RAD < MOST_RATIO
    if (has_turned and too_fast) or scan.most_gyro_radps > MOST_RADPS:
        turned = f"turns {gain:.1f} times as fast as the wheels" if has_turned else "reaches"
        raise RecordingError(
            f"{_name(log, 'imu')}: the gyro {turned} ({scan.most_gyro_radps:.0f} at most); its "
            "unit is degrees a second; write rad/s"
        )
    if has_turned and too_slow:
        raise RecordingError(
            f"{_name(log, 'odom')}: the wheels turn {1.0 / gain:.1f} times as fast as the gyro; "
            "their yaw rate is in degrees a second; write rad/s"
        )


def _check_accel(log: RobotLog, scan: LogScan) -> None:
    mean_mps2 = float(np.linalg.norm(scan.mount.gravity_mps2))
    for unit, size_mps2 in (("g", GRAVITY_MPS2), ("mg", GRAVITY_MPS2 / 1000.0)):
        if 0.8 < mean_mps2 / GRAVITY_MPS2 * size_mps2 < 1.25:
            raise RecordingError(
                f"{_name(log, 'imu')}: the acceleration at rest is {mean_mps2:.2f}; its unit is "
                f"{unit}; write m/s^2 ({GRAVITY_MPS2} at rest)"
            )
    if mean_mps2 > 1.25 * GRAVITY_MPS2:
        raise RecordingError(
            f"{_name(log, 'imu')}: the acceleration at rest is {mean_mps2:.1f} m/s^2, not "
            f"{GRAVITY_MPS2}; check its unit and range"
        )


def _check_way(log: RobotLog, scan: LogScan) -> None:
    ratio = scan.way_ratio
    if ratio is None or LEAST_RATIO < ratio < MOST_RATIO:
        return
    _check_radians(log, scan, ratio)
    unit = next((unit for by, unit in _FACTORS.items() if 0.8 < ratio / by < 1.25), None)
    looks = f"they look like {unit}" if unit else "one of them has a wrong unit or size of wheel"
    raise RecordingError(
        f"{_name(log, 'odom')}: the wheels drove {ratio:.3g} times as far as {_name(log, 'gnss')} "
        f"moved; {looks}; write metres, and check --radius"
    )


def _check_sides(log: RobotLog, scan: LogScan) -> None:
    if scan.turn_agreement < MIRRORED:
        raise RecordingError(
            f"{_name(log, 'odom')}: the wheels turn to the right where {_name(log, 'gnss')} turns "
            "to the left; left and right are swapped, or the sign of the yaw rate is wrong; "
            "positive is to the left"
        )


def _check_radians(log: RobotLog, scan: LogScan, ratio: float) -> None:
    fix = scan.first_fix
    assert fix is not None
    is_small = abs(fix.lat_deg) <= math.pi / 2.0 and abs(fix.lon_deg) <= math.pi
    if is_small and LEAST_RADIANS_RATIO < ratio < 1.25 * DEGREES_PER_RAD:
        raise RecordingError(
            f"{_name(log, 'gnss')}: latitude {fix.lat_deg:.6f}, longitude {fix.lon_deg:.6f} are "
            f"radians: the wheels drove {ratio:.0f} times as far; write degrees"
        )


def _list_notes(log: RobotLog, scan: LogScan) -> Iterator[str]:
    for channel in log.channels:
        if channel.others:
            yield (
                f"{channel.sensor}: {channel.source} is used, {', '.join(channel.others)} could "
                f"be (--{channel.sensor})"
            )
    for sensor, times in scan.sensors.items():
        name = _name(log, sensor)
        if times.backwards:
            yield f"{name}: {times.backwards} messages stand behind their order"
        if times.count > times.samples:
            yield f"{name}: {times.count - times.samples} messages hold no measurement"
        if len(times.frames) > 1 and sensor == "gnss":
            counts = ", ".join(f"{count} of {name}" for name, count in times.frames.most_common())
            yield f"{name}: two receivers on one topic ({counts}); the first is used"
    if np.linalg.norm(scan.mount.gravity_mps2) < LEAST_GRAVITY_MPS2:
        yield f"{_name(log, 'imu')}: it subtracts gravity; slopes are not seen"
    slope = scan.mount.fit_turns()[0]
    gain = float(np.linalg.norm(slope))
    if gain > 0.0 and not 0.8 < gain < 1.25:
        yield (
            f"the gyro turns {gain:.2f} times as fast as the wheels; state --track, or the "
            "wheels skid"
        )
