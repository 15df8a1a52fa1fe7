"""The same drive in every format is the same samples."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path

import msgspec
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from agribot.app.localization.log import LogEntry, LogSensor, TwistSample
from agribot.app.localization.log_files import open_log
from agribot.app.localization.time_order import order_by_stamp
from agribot.core import topics
from agribot.core.errors import RecordingError
from agribot.core.messages import (
    FloatArray,
    GnssFix,
    GnssQuality,
    ImuSample,
    MagSample,
    WheelSample,
)
from agribot.drivers.gnss.ubx_writer import RUN_BEGINS
from agribot.record.bag.convert import ConvertOptions, convert
from agribot.record.bag.definitions import ros1_store, ros2_store
from tests.app.localization import drives
from tests.app.localization.drives import START_S, Drive, Message, Messages, make_drive
from tests.record.bag.bag_samples import write_run

RADIUS_M, TRACK_M, TICKS = 0.12, 0.6, 4000.0


@pytest.fixture(scope="module")
def drive() -> Drive:
    return make_drive(duration_s=6.0)


def write_sqlite(folder: Path, drive: Drive) -> list[Path]:
    messages = Messages(drive, ros2_store()).list()
    drives.write_ros2(folder / "bag", messages, StoragePlugin.SQLITE3)
    return [folder / "bag"]


def write_mcap(folder: Path, drive: Drive) -> list[Path]:
    messages = Messages(drive, ros2_store()).list()
    drives.write_ros2(folder / "bag", messages, StoragePlugin.MCAP)
    return [next((folder / "bag").glob("*.mcap"))]


def write_bag(folder: Path, drive: Drive) -> list[Path]:
    drives.write_ros1(folder / "drive.bag", Messages(drive, ros1_store()).list())
    return [folder / "drive.bag"]


def write_two_bags(folder: Path, drive: Drive) -> list[Path]:
    messages = Messages(drive, ros1_store()).list()
    half = len(messages) // 2
    drives.write_ros1(folder / "a.bag", messages[:half])
    drives.write_ros1(folder / "b.bag", messages[half:])
    return [folder / "a.bag", folder / "b.bag"]


def write_nmea_and_tables(folder: Path, drive: Drive) -> list[Path]:
    drives.write_tables(folder, drive)
    drives.write_nmea(folder / "gnss.nmea", drive)
    (folder / "photo.png").write_bytes(b"\x89PNG and no log")
    return [folder]


def write_ubx_and_tables(folder: Path, drive: Drive) -> list[Path]:
    drives.write_tables(folder, drive)
    drives.write_ubx(folder / "gnss.ubx", drive)
    return [folder / name for name in ("gnss.ubx", "imu.csv", "odom.csv", "mag.csv")]


def entries_of(paths: list[Path], named: dict[LogSensor, str] | None = None) -> list[LogEntry]:
    return list(order_by_stamp(open_log(paths, named or {}, TICKS).entries()))


def table(entries: list[LogEntry], sensor: str) -> FloatArray:
    """Times of the drive and values of a sensor, one row a sample."""

    def row(entry: LogEntry) -> Iterator[float]:
        yield entry.stamp_s - START_S
        match entry.sample:
            case GnssFix() as fix:
                yield from (fix.lat_deg, fix.lon_deg, fix.alt_m, fix.pos_std_m)
            case ImuSample() as imu:
                yield from (*imu.gyro_radps, *(imu.accel_mps2 or ()))
            case MagSample() as mag:
                yield from mag.field_t
            case TwistSample() as twist:
                yield from (twist.v_mps, twist.yaw_rate_radps)
            case WheelSample() as wheels:
                yield from (wheels.angle_rad[1], wheels.angle_rad[0], *wheels.speed_radps[:2])

    return np.array([list(row(entry)) for entry in entries if entry.sensor == sensor])


@pytest.mark.parametrize(
    "write",
    [write_bag, write_two_bags, write_sqlite, write_mcap, write_nmea_and_tables,
     write_ubx_and_tables],
)  # fmt: skip
def test_each_format_gives_the_samples_of_the_drive(
    write: Callable[[Path, Drive], list[Path]], drive: Drive, tmp_path: Path
) -> None:
    entries = entries_of(write(tmp_path, drive))
    assert [entry.stamp_s for entry in entries] == sorted(entry.stamp_s for entry in entries)
    assert table(entries, "imu") == pytest.approx(drive.imu, abs=1e-6)
    assert table(entries, "odom") == pytest.approx(drive.odom, abs=1e-6)
    assert table(entries, "mag") == pytest.approx(drive.mag, abs=1e-6)
    fixes = [
        (fix.t_s, fix.lat_deg, fix.lon_deg, fix.alt_m, fix.pos_std_m)
        for fix in drives.list_fixes(drive)
    ]
    found = table(entries, "gnss")
    assert found[:, 1:3] == pytest.approx(np.array(fixes)[:, 1:3], abs=1.1e-7)  # 1 cm
    assert np.delete(found, [1, 2], 1) == pytest.approx(np.delete(fixes, [1, 2], 1), abs=0.0101)
    qualities = {e.sample.quality for e in entries if isinstance(e.sample, GnssFix)}
    assert qualities == {GnssQuality.DGNSS}


def test_reports_of_gpsd_are_fixes(drive: Drive, tmp_path: Path) -> None:
    fixes = list(drives.list_fixes(drive))
    lines = [
        {
            "class": "TPV", "device": "/dev/ttyACM0", "mode": 3, "lat": fix.lat_deg,
            "lon": fix.lon_deg, "altHAE": fix.alt_m, "epx": 0.7, "epy": 0.7,
            "time": (RUN_BEGINS + timedelta(seconds=fix.t_s)).isoformat().replace("+00:00", "Z"),
        }
        for fix in fixes
    ]  # fmt: skip
    (tmp_path / "gpsd.json").write_bytes(b"\n".join(msgspec.json.encode(each) for each in lines))
    found = table(entries_of([tmp_path / "gpsd.json"]), "gnss")
    wanted = [(fix.t_s, fix.lat_deg, fix.lon_deg) for fix in fixes]
    assert found[:, :3] == pytest.approx(np.array(wanted)[: len(found)], abs=1e-6)
    assert len(found) >= len(fixes) - 1


def test_a_recording_of_ours_gives_the_very_samples_that_the_robot_had(tmp_path: Path) -> None:
    write_run(tmp_path / "run.mcap", count=20)
    entries = entries_of([tmp_path])
    assert {entry.sensor for entry in entries} >= {"imu", "odom", "gnss"}
    assert all(entry.stamp_s == entry.sample.t_s for entry in entries if entry.sample)


def test_a_recording_of_ours_as_a_bag_of_another_format_is_read_by_its_topics(
    tmp_path: Path,
) -> None:
    write_run(tmp_path / "run.mcap", count=20)
    convert(tmp_path / "run.mcap", tmp_path / "a.bag", ConvertOptions())
    sources = {each.sensor: each.source for each in open_log([tmp_path / "a.bag"], {}).channels}
    assert sources == {
        "gnss": topics.FIX.name, "imu": topics.IMU.name, "odom": topics.ODOM.name,
        "mag": topics.MAGNETIC.name,
    }  # fmt: skip


class OtherOdometry(Messages):
    """The same drive, with odometry of another type."""

    def convert(self, write: Callable[[float, float, float], tuple[str, object]]) -> list[Message]:
        others = [each for each in self.list() if each[1] != "/odom"]
        rows = [(t, *write(t, v, w)) for t, v, w in self.drive.odom.tolist()]
        return sorted(
            [*others, *((t, "/base", kind, message) for t, kind, message in rows)],
            key=lambda each: each[0],
        )


def test_twists_with_and_without_a_stamp_are_odometry(drive: Drive, tmp_path: Path) -> None:
    ros = OtherOdometry(drive, ros2_store())
    kind = "geometry_msgs/msg/TwistStamped"
    messages = ros.convert(
        lambda t, v, w: (kind, ros.make(kind, ros.header(t, "base_link"), ros.twist(v, w)))
    )
    drives.write_ros2(tmp_path / "stamped", messages, StoragePlugin.MCAP)
    assert table(entries_of([tmp_path / "stamped"]), "odom") == pytest.approx(drive.odom, abs=1e-6)
    bare = ros.convert(lambda t, v, w: ("geometry_msgs/msg/Twist", ros.twist(v, w)))
    drives.write_ros2(tmp_path / "bare", bare, StoragePlugin.MCAP)
    assert len(table(entries_of([tmp_path / "bare"]), "odom")) == 0  # it may be a command
    found = table(entries_of([tmp_path / "bare"], {"odom": "/base"}), "odom")
    assert found == pytest.approx(drive.odom, abs=1e-6)


def wheel_angles(drive: Drive) -> FloatArray:
    """Time, and angles of the left and the right wheel."""
    t, v, w = drive.odom.T
    speeds = np.column_stack([v - w * TRACK_M / 2.0, v + w * TRACK_M / 2.0]) / RADIUS_M
    steps = np.diff(t, prepend=t[0])[:, None]
    return np.column_stack([t, np.cumsum(speeds * steps, axis=0)])


def test_wheel_speeds_are_read_by_the_sides_in_the_names_of_joints(
    drive: Drive, tmp_path: Path
) -> None:
    ros = OtherOdometry(drive, ros2_store())
    kind = "sensor_msgs/msg/JointState"
    names = ["front_right_wheel", "front_left_wheel", "arm_left", "rear_left_wheel",
             "rear_right_wheel"]  # fmt: skip
    angles = {round(t, 3): (left, right) for t, left, right in wheel_angles(drive).tolist()}

    def write(t: float, v: float, w: float) -> tuple[str, object]:
        left, right = (v - w * TRACK_M / 2.0) / RADIUS_M, (v + w * TRACK_M / 2.0) / RADIUS_M
        left_rad, right_rad = angles[round(t, 3)]
        position = np.array([right_rad, left_rad, 9.0, left_rad, right_rad])
        velocity = np.array([right, left, 9.0, left, right])
        return kind, ros.make(kind, ros.header(t, ""), names, position, velocity, np.zeros(0))

    drives.write_ros2(tmp_path / "joints", ros.convert(write), StoragePlugin.MCAP)
    found = table(entries_of([tmp_path / "joints"]), "odom")
    assert found[:, :3] == pytest.approx(wheel_angles(drive), abs=1e-6)


def test_encoder_counts_of_two_topics_and_of_a_table_are_angles(
    drive: Drive, tmp_path: Path
) -> None:
    counts = np.rint(wheel_angles(drive)[:, 1:] / (2.0 * np.pi) * TICKS)
    rows = np.column_stack([drive.odom[:, 0], counts])
    drives.write_table(tmp_path / "t.csv", ["stamp_s", "left_ticks", "right_ticks"], rows)
    from_table = table(entries_of([tmp_path / "t.csv"]), "odom")
    ros = OtherOdometry(drive, ros2_store())
    kind = "std_msgs/msg/Int64"
    messages: list[Message] = [
        (t, f"/{side}", kind, ros.make(kind, int(count)))
        for t, left, right in rows.tolist()
        for side, count in (("left", left), ("right", right))
    ]
    drives.write_ros2(tmp_path / "bag", messages, StoragePlugin.SQLITE3)
    from_bag = table(entries_of([tmp_path / "bag"], {"odom": "/left,/right"}), "odom")
    for found in (from_table, from_bag[-len(rows) :]):
        assert found[:, :3] == pytest.approx(wheel_angles(drive), abs=np.pi / TICKS + 1e-6)
    with pytest.raises(RecordingError, match="give --ticks-per-turn"):
        list(open_log([tmp_path / "bag"], {"odom": "/left,/right"}).entries())


def test_odometry_that_states_no_twist_is_read_by_its_pose(drive: Drive, tmp_path: Path) -> None:
    ros = OtherOdometry(drive, ros2_store())

    def write(t: float, v: float, w: float) -> tuple[str, object]:
        message = ros.odometry(t, 0.0, 0.0)
        _, x_m, y_m, yaw_rad = drive.truth[round(t * 100)].tolist()
        message.pose.pose.position.x, message.pose.pose.position.y = x_m, y_m
        message.pose.pose.orientation.z = np.sin(yaw_rad / 2.0)
        message.pose.pose.orientation.w = np.cos(yaw_rad / 2.0)
        return "nav_msgs/msg/Odometry", message

    drives.write_ros2(tmp_path / "bag", ros.convert(write), StoragePlugin.MCAP)
    found = table(entries_of([tmp_path / "bag"]), "odom")
    assert found[1:, 1:] == pytest.approx(drive.odom[:-1, 1:], abs=0.15)
    assert found[-1, 1] > 0.4


def test_columns_may_be_in_other_units_that_their_names_state(drive: Drive, tmp_path: Path) -> None:
    names = ["t_ms", "gyro_x_dps", "gyro_y_dps", "gyro_z_dps", "accel_x_g", "accel_y_g",
             "accel_z_g"]  # fmt: skip
    rows = np.column_stack([np.degrees(drive.imu[:, 1:4]), drive.imu[:, 4:] / 9.80665])
    text = ",".join(names) + "\n"
    for t_s, values in zip(drive.imu[:, 0], rows, strict=True):
        text += f"{(START_S + t_s) * 1e3:.3f}," + ",".join(map(repr, values.tolist())) + "\n"
    (tmp_path / "imu.csv").write_text(text)
    found = table(entries_of([tmp_path / "imu.csv"]), "imu")
    assert found == pytest.approx(drive.imu, abs=1e-6)


def test_empty_cells_are_no_measurements_so_that_one_table_may_hold_all(tmp_path: Path) -> None:
    (tmp_path / "all.csv").write_text(
        "t_s;v_mps;yaw_rate_radps;lat_deg;lon_deg;note\n"
        "1.0;0.5;0.1;;;begins\n1.1;;;49.5;8.1;\n1.2;nan;nan;49.6;8.2;\n\n1.3;0.6;0.2;;;ends\n"
    )
    entries = entries_of([tmp_path / "all.csv"])
    assert [(entry.sensor, entry.stamp_s) for entry in entries] == [
        ("odom", 1.0), ("gnss", 1.1), ("gnss", 1.2), ("odom", 1.3),
    ]  # fmt: skip
    (tmp_path / "bad.csv").write_text("t_s,v_mps,yaw_rate_radps\n1.0,0.5,0.1\n1.1,fast,0.1\n")
    with pytest.raises(RecordingError, match=r"bad\.csv:3: could not convert .*'fast'"):
        entries_of([tmp_path / "bad.csv"])
    (tmp_path / "inf.csv").write_text("t_s,v_mps,yaw_rate_radps\n1.0,inf,0.1\n")
    with pytest.raises(RecordingError, match=r"inf\.csv:2: inf is not finite"):
        entries_of([tmp_path / "inf.csv"])


def test_velocities_of_a_receiver_and_odometry_of_a_filter_are_no_wheels(
    drive: Drive, tmp_path: Path
) -> None:
    ros = Messages(drive, ros2_store())
    renamed: list[Message] = [
        (t_s, "/odometry/filtered" if topic == "/odom" else topic, kind, message)
        for t_s, topic, kind, message in ros.list()
    ]
    kind = "geometry_msgs/msg/TwistStamped"
    renamed += [
        (fix.t_s, "/vel", kind, ros.make(kind, ros.header(fix.t_s, "gps"), ros.twist(1.0, 0.0)))
        for fix in drives.list_fixes(drive)
    ]
    drives.write_ros2(tmp_path / "bag", renamed, StoragePlugin.MCAP)
    log = open_log([tmp_path / "bag"], {})
    assert "odom" not in {channel.sensor for channel in log.channels}
    assert log.notes[0].startswith("/odometry/filtered, /vel may be no measurement of the wheels")
    named = open_log([tmp_path / "bag"], {"odom": "/odometry/filtered"})
    assert {channel.sensor for channel in named.channels} == {"gnss", "imu", "odom", "mag"}


def test_a_table_that_agribot_bag_csv_wrote_is_read(drive: Drive, tmp_path: Path) -> None:
    from agribot.record.bag.table import write_table

    (bag,) = write_mcap(tmp_path, drive)
    for topic, name in (("/imu", "imu"), ("/odom", "odom"), ("/fix", "fix")):
        write_table(bag, topic, tmp_path / f"{name}.csv")
    entries = entries_of([tmp_path / f"{name}.csv" for name in ("imu", "odom", "fix")])
    assert table(entries, "imu") == pytest.approx(drive.imu, abs=1e-6)
    assert table(entries, "odom") == pytest.approx(drive.odom, abs=1e-6)
    assert len(table(entries, "gnss")) == len(drive.fixes)


def test_a_sensor_may_be_named_by_its_topic_or_its_file(drive: Drive, tmp_path: Path) -> None:
    (bag,) = write_bag(tmp_path, drive)
    faster = msgspec.structs.replace(drive, odom=drive.odom * [1.0, 2.0, 2.0])
    drives.write_table(tmp_path / "o.csv", drives.ODOM_NAMES, faster.odom)
    found = entries_of([bag], {"odom": str(tmp_path / "o.csv"), "gnss": "/fix"})
    assert table(found, "odom") == pytest.approx(faster.odom, abs=1e-6)
    assert len(table(found, "gnss")) == len(drive.fixes)
    with pytest.raises(RecordingError, match=r"no topic /wheels; it has: /fix, /imu"):
        open_log([bag], {"odom": "/wheels"})
    with pytest.raises(
        RecordingError, match=r"/fix is sensor_msgs/msg/NavSatFix, which is no odom"
    ):
        open_log([bag], {"odom": "/fix"})


def test_a_file_that_is_no_log_is_refused_with_what_it_begins_with(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(b"\x00\x01\x02\x03 nothing")
    with pytest.raises(RecordingError, match="is no log: it begins with"):
        open_log([tmp_path / "a.bin"], {})
    (tmp_path / "b.csv").write_text("stamp_s,weight_kg,colour\n1,2,3\n")
    with pytest.raises(RecordingError, match="has no columns of a sensor"):
        open_log([tmp_path / "b.csv"], {})
    (tmp_path / "c.csv").write_text("v_mps,yaw_rate_radps,note\n1,2,3\n")
    with pytest.raises(RecordingError, match="has no column of times"):
        open_log([tmp_path / "c.csv"], {})
