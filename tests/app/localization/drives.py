"""A drive that is known, and logs of it as other programs leave them behind."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys.store import Typestore

from agribot.core.geo import Datum, MapFrame, rotation_from_rpy
from agribot.core.messages import FloatArray, GnssFix, GnssQuality
from agribot.drivers.gnss import nmea
from agribot.drivers.gnss.ubx_writer import RUN_BEGINS, write_fix
from agribot.record.bag.definitions import ros1_store, ros2_store
from tests.record.bag.bag_samples import header

START_S = RUN_BEGINS.timestamp()
DATUM = Datum(lat_deg=49.5, lon_deg=8.1, alt_m=120.0)
STEP_S = 0.01
ODOM_S, IMU_S, GNSS_S, MAG_S = 0.1, 0.04, 0.4, 0.2
STANDS_S = 3.0
GRAVITY_MPS2 = 9.81
FIELD_T = (0.0, 2e-5, -4e-5)  # magnetic north is North


class Drive(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Columns of t_s and values. IMU and magnetometer are in the IMU's axes.

    `truth` is x, y, yaw at every step; `odom` v, yaw rate; `imu` gyro, acceleration; `fixes` East,
    North of the antenna, which is above the body's origin.
    """

    truth: FloatArray
    odom: FloatArray
    imu: FloatArray
    fixes: FloatArray
    mag: FloatArray
    fix_std_m: float

    def places(self, t_s: FloatArray) -> FloatArray:
        """True x, y (N, 2) at times."""
        t = self.truth[:, 0]
        return np.column_stack([np.interp(t_s, t, self.truth[:, i]) for i in (1, 2)])


def make_drive(
    seed: int = 1,
    duration_s: float = 90.0,
    fix_std_m: float = 0.5,
    body_from_imu: FloatArray | None = None,
    accel_noise_mps2: float = 0.2,
) -> Drive:
    """Drive some curves, faster and slower, after standing still."""
    dice = np.random.default_rng(seed)
    t = np.arange(0.0, duration_s, STEP_S)
    going = np.clip(t - STANDS_S, 0.0, 1.0)
    v = going * (0.8 + 0.35 * np.sin(0.9 * t))
    w = going * (0.25 * np.sin(0.21 * t) + 0.2 * np.sin(0.5 * t + 1.0))
    yaw = 0.4 + np.cumsum(w) * STEP_S
    x = np.cumsum(v * np.cos(yaw)) * STEP_S
    y = np.cumsum(v * np.sin(yaw)) * STEP_S
    ahead = np.gradient(v, STEP_S)
    imu_from_body = np.eye(3) if body_from_imu is None else body_from_imu.T

    def pick(period_s: float, offset_s: float) -> Any:
        return np.arange(int(offset_s / STEP_S), len(t), round(period_s / STEP_S))

    i = pick(IMU_S, 0.0)
    gyro = np.column_stack([np.zeros((len(i), 2)), w[i] + 0.001])
    accel = np.column_stack([ahead[i], v[i] * w[i], np.full(len(i), GRAVITY_MPS2)])
    gyro += dice.normal(0.0, 0.002, gyro.shape)
    accel += dice.normal(0.0, accel_noise_mps2, accel.shape)
    o = pick(ODOM_S, 0.02)
    odom = np.column_stack([t[o], v[o] * 1.01, w[o]])
    g = pick(GNSS_S, 0.1)
    places = np.column_stack([x[g], y[g]]) + dice.normal(0.0, fix_std_m, (len(g), 2))
    m = pick(MAG_S, 0.06)
    north, down = FIELD_T[1], FIELD_T[2]
    field = np.column_stack([north * np.sin(yaw[m]), north * np.cos(yaw[m]), np.full(len(m), down)])
    field += dice.normal(0.0, 5e-7, field.shape)
    return Drive(
        truth=np.column_stack([t, x, y, yaw]),
        odom=odom,
        imu=np.column_stack([t[i], gyro @ imu_from_body.T, accel @ imu_from_body.T]),
        fixes=np.column_stack([t[g], places]),
        mag=np.column_stack([t[m], field @ imu_from_body.T]),
        fix_std_m=fix_std_m,
    )


def list_fixes(drive: Drive) -> Iterator[GnssFix]:
    """Fixes with the time of the drive."""
    frame = MapFrame(DATUM)
    for t_s, east_m, north_m in drive.fixes.tolist():
        lat_deg, lon_deg, _ = frame.geodetic_from_map(east_m, north_m)
        yield GnssFix(
            t_s=t_s, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=DATUM.alt_m,
            pos_std_m=drive.fix_std_m, quality=GnssQuality.DGNSS,
        )  # fmt: skip


Message = tuple[float, str, str, Any]  # time, topic, type, message


class Messages:
    """The drive as ROS messages of one version; methods may be overridden by a test."""

    def __init__(self, drive: Drive, store: Typestore) -> None:
        self.drive, self.store = drive, store

    def make(self, kind: str, *values: Any) -> Any:
        return self.store.types[kind](*values)

    def header(self, t_s: float, frame: str) -> Any:
        return header(self.store, round((START_S + t_s) * 1e9), frame)

    def vector(self, x: float, y: float, z: float) -> Any:
        return self.make("geometry_msgs/msg/Vector3", x, y, z)

    def twist(self, v_mps: float, yaw_radps: float) -> Any:
        return self.make(
            "geometry_msgs/msg/Twist",
            self.vector(v_mps, 0.0, 0.0),
            self.vector(0.0, 0.0, yaw_radps),
        )

    def odometry(self, t_s: float, v_mps: float, yaw_radps: float) -> Any:
        pose = self.make(
            "geometry_msgs/msg/Pose",
            self.make("geometry_msgs/msg/Point", 0.0, 0.0, 0.0),
            self.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0),
        )
        return self.make(
            "nav_msgs/msg/Odometry", self.header(t_s, "odom"), "base_link",
            self.make("geometry_msgs/msg/PoseWithCovariance", pose, np.zeros(36)),
            self.make(
                "geometry_msgs/msg/TwistWithCovariance", self.twist(v_mps, yaw_radps), np.zeros(36)
            ),
        )  # fmt: skip

    def imu(self, t_s: float, gyro: FloatArray, accel: FloatArray) -> Any:
        return self.make(
            "sensor_msgs/msg/Imu", self.header(t_s, "imu_link"),
            self.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0), np.zeros(9),
            self.vector(*gyro), np.zeros(9), self.vector(*accel), np.zeros(9),
        )  # fmt: skip

    def fix(self, fix: GnssFix) -> Any:
        return self.make(
            "sensor_msgs/msg/NavSatFix", self.header(fix.t_s, "gps"),
            self.make("sensor_msgs/msg/NavSatStatus", 1, 1), fix.lat_deg, fix.lon_deg, fix.alt_m,
            np.diag([fix.pos_std_m**2] * 3).ravel(), 2,
        )  # fmt: skip

    def mag(self, t_s: float, field: FloatArray) -> Any:
        return self.make(
            "sensor_msgs/msg/MagneticField", self.header(t_s, "imu_link"), self.vector(*field),
            np.zeros(9),
        )  # fmt: skip

    def frame(self, parent: str, child: str, roll_deg: float, yaw_deg: float) -> Any:
        """A fixed frame, 0.3 m ahead of its parent and 1.2 m above it."""
        roll, yaw = np.radians([roll_deg, yaw_deg]) / 2.0
        turn = (
            np.sin(roll) * np.cos(yaw), np.sin(roll) * np.sin(yaw),
            np.cos(roll) * np.sin(yaw), np.cos(roll) * np.cos(yaw),
        )  # fmt: skip
        return self.make(
            "geometry_msgs/msg/TransformStamped", self.header(0.0, parent), child,
            self.make(
                "geometry_msgs/msg/Transform", self.vector(0.3, 0.0, 1.2),
                self.make("geometry_msgs/msg/Quaternion", *map(float, turn)),
            ),
        )  # fmt: skip

    def list(self) -> list[Message]:
        """All messages in the order of their times."""
        drive = self.drive
        found: list[Message] = [
            (t_s, "/odom", "nav_msgs/msg/Odometry", self.odometry(t_s, v, w))
            for t_s, v, w in drive.odom.tolist()
        ]
        found += [
            (row[0], "/imu", "sensor_msgs/msg/Imu", self.imu(row[0], row[1:4], row[4:]))
            for row in drive.imu
        ]
        found += [
            (fix.t_s, "/fix", "sensor_msgs/msg/NavSatFix", self.fix(fix))
            for fix in list_fixes(drive)
        ]
        found += [
            (row[0], "/mag", "sensor_msgs/msg/MagneticField", self.mag(row[0], row[1:]))
            for row in drive.mag
        ]
        return sorted(found, key=lambda each: each[0])


def write_ros1(path: Path, messages: list[Message]) -> None:
    store = ros1_store()
    with rosbag1.Writer(path) as writer:
        topics: dict[str, Any] = {}
        for t_s, topic, kind, message in messages:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(topics[topic], to_ns(t_s), store.serialize_ros1(message, kind))


def write_ros2(folder: Path, messages: list[Message], plugin: StoragePlugin) -> None:
    store = ros2_store()
    with rosbag2.Writer(folder, version=9, storage_plugin=plugin) as writer:
        topics: dict[str, Any] = {}
        for t_s, topic, kind, message in messages:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(topics[topic], to_ns(t_s), store.serialize_cdr(message, kind))


def to_ns(t_s: float) -> int:
    return round((START_S + t_s) * 1e9)


def write_table(path: Path, names: list[str], rows: FloatArray) -> None:
    """Write a CSV file; the first column of `rows` is the time of the drive."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(
            [[f"{START_S + row[0]:.6f}", *map(repr, row[1:].tolist())] for row in rows]
        )


IMU_NAMES = [
    "stamp_s", "gyro_x_radps", "gyro_y_radps", "gyro_z_radps", "accel_x_mps2", "accel_y_mps2",
    "accel_z_mps2",
]  # fmt: skip
ODOM_NAMES = ["stamp_s", "v_mps", "yaw_rate_radps"]
MAG_NAMES = ["stamp_s", "mag_x_t", "mag_y_t", "mag_z_t"]


def write_tables(folder: Path, drive: Drive) -> None:
    """Write imu.csv, odom.csv and mag.csv."""
    folder.mkdir(exist_ok=True)
    write_table(folder / "imu.csv", IMU_NAMES, drive.imu)
    write_table(folder / "odom.csv", ODOM_NAMES, drive.odom)
    write_table(folder / "mag.csv", MAG_NAMES, drive.mag)


def write_nmea(path: Path, drive: Drive) -> None:
    """Write the fixes as GGA and GST, with the date in RMC."""
    day = RUN_BEGINS.strftime("%d%m%y")
    data = b""
    for fix in list_fixes(drive):
        stamp_s = START_S + fix.t_s
        gga = nmea.write_gga(nmea.StampedFix(stamp_s, fix)).decode()
        time = gga.split(",")[1]
        std = f"{fix.pos_std_m:.3f}"
        data += gga.encode()
        data += nmea.write_sentence(f"GPRMC,{time},V,,,,,,,{day},,,N")
        data += nmea.write_sentence(f"GPGST,{time},,,,,{std},{std},1.0")
    path.write_bytes(data)


def write_ubx(path: Path, drive: Drive) -> None:
    path.write_bytes(b"".join(write_fix(fix) for fix in list_fixes(drive)))


def find_error_m(folder: Path, drive: Drive) -> FloatArray:
    """Distance of the poses of `poses.tum` from the truth, m, in time order."""
    poses = np.loadtxt(folder / "poses.tum", ndmin=2)
    # The map's origin is the first fix, the truth's is where the drive began.
    offset = drive.fixes[0, 1:3]
    off_m = poses[:, 1:3] + offset - drive.places(poses[:, 0] - START_S)
    error_m: FloatArray = np.hypot(off_m[:, 0], off_m[:, 1])
    return error_m


def rotation_deg(roll: float, pitch: float, yaw: float) -> FloatArray:
    return rotation_from_rpy(*np.radians([roll, pitch, yaw]))
