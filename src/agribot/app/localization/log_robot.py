"""The robot of a log: a description, or wheels and antenna as stated."""

from __future__ import annotations

import msgspec

from agribot.app.localization.log_scan import LogScan
from agribot.core.messages import FloatArray, Vec3
from agribot.core.robot import DriveSpec, Joint, Link, Origin, RobotSpec, SensorMount

ANTENNA_LINK = "log_antenna"
# Share by which the way of an odometry may differ from that of the fixes: the filter learns more
# than that as slip, which it forgets.
WAY_ROOM_RATIO = 0.05
# Room above the fastest reading of a log, so that none counts as an encoder that restarted.
SPEED_ROOM_RATIO = 1.2


def set_wheels(robot: RobotSpec, track_m: float | None, radius_m: float | None) -> RobotSpec:
    """Return the robot with stated wheels; a stated track is the effective one."""
    drive = robot.drive
    if radius_m is not None:
        drive = msgspec.structs.replace(drive, wheel_radius_m=radius_m)
    if track_m is not None:
        drive = msgspec.structs.replace(drive, track_m=track_m, yaw_multiplier=1.0)
    return msgspec.structs.replace(robot, drive=drive)


def set_antenna(robot: RobotSpec, antenna_body_m: Vec3) -> RobotSpec:
    """Return the robot with its antenna at a place in the body frame, on the ground below it."""
    x_m, y_m, z_m = antenna_body_m
    origin = Origin(xyz_m=(x_m, y_m, z_m - robot.base_height_m))
    joint = Joint(
        name=ANTENNA_LINK, kind="fixed", parent="base_link", child=ANTENNA_LINK, origin=origin
    )
    return msgspec.structs.replace(
        robot,
        links=(*robot.links, Link(name=ANTENNA_LINK)),
        joints=(*robot.joints, joint),
        gnss=SensorMount(link=ANTENNA_LINK, rate_hz=robot.gnss.rate_hz),
    )


def place_antenna(
    robot: RobotSpec, stated_m: Vec3 | None, base_from_antenna: FloatArray | None, *, is_known: bool
) -> tuple[RobotSpec, str]:
    """Put the antenna where it is stated, by the robot, or by its frame; return that in words, too.

    `is_known` says that the robot's own description counts.
    """
    if stated_m is not None:
        place_m, how = stated_m, "as stated"
    elif is_known:
        place_m, how = find_antenna_m(robot), f"of robot {robot.name}"
    elif base_from_antenna is not None:
        x_m, y_m, z_m = base_from_antenna[:3, 3].tolist()
        place_m, how = (x_m, y_m, z_m), "by its frame"
    else:
        place_m, how = (0.0, 0.0, 0.0), "assumed; state --antenna X,Y,Z"
    where = ", ".join(f"{part:.2f}" for part in place_m)
    return set_antenna(robot, place_m), f"antenna at {where} m of the body ({how})"


def allow_speeds(drive: DriveSpec, most_mps: float, most_radps: float) -> DriveSpec:
    """Return the drive with limits that no reading of the log exceeds."""
    return msgspec.structs.replace(
        drive,
        max_speed_mps=max(drive.max_speed_mps, SPEED_ROOM_RATIO * most_mps),
        max_yaw_rate_radps=max(drive.max_yaw_rate_radps, SPEED_ROOM_RATIO * most_radps),
    )


def find_antenna_m(robot: RobotSpec) -> Vec3:
    x_m, y_m, z_m = robot.body_from_link(robot.gnss.link)[:3, 3].tolist()
    return x_m, y_m, z_m


def fit_wheels(
    robot: RobotSpec, scan: LogScan, *, has_radius: bool, has_track: bool
) -> tuple[RobotSpec, tuple[str, ...]]:
    """Find what is not stated of wheels that report their turns: by the fixes and by the gyro.

    Returns: the robot, and in words what was found.
    """
    drive, words = robot.drive, []
    ratio, gain = scan.way_ratio, scan.turn_gain
    radius_m, separation_m = drive.wheel_radius_m, drive.effective_separation_m
    if not has_radius and ratio is not None:
        radius_m /= ratio
        words.append(f"wheel radius of {radius_m:.3f} m found from the fixes")
    elif not has_radius:
        words.append(f"wheel radius of {radius_m:.3f} m assumed, the way is short; state --radius")
    if not has_track and gain is not None:
        separation_m *= radius_m / drive.wheel_radius_m / gain
        words.append(f"effective track of {separation_m:.2f} m found from the gyro")
        drive = msgspec.structs.replace(drive, track_m=separation_m, yaw_multiplier=1.0)
    elif not has_track:
        words.append(f"track of {separation_m:.2f} m assumed, it hardly turns; state --track")
    drive = msgspec.structs.replace(drive, wheel_radius_m=radius_m)
    return msgspec.structs.replace(robot, drive=drive), tuple(words)


def find_way_ratio(scan: LogScan) -> float:
    """Find how many times too far an odometry drives that states speeds; 1 where that is little."""
    ratio = None if scan.has_wheels else scan.way_ratio
    return ratio if ratio is not None and abs(ratio - 1.0) > WAY_ROOM_RATIO else 1.0
