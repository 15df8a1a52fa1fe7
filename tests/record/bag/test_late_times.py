"""Times that a format or a version of ROS cannot hold are left out and counted, never changed."""

from __future__ import annotations

from pathlib import Path

import pytest
from rosbags import rosbag1, rosbag2

from agribot.record.bag.convert import convert
from agribot.record.bag.definitions import ros1_store, ros2_store
from tests.record.bag import bag_samples as samples

S = 1_000_000_000
IN_2026, IN_2040, IN_2109 = 1_780_000_000, 2_210_000_000, 4_390_000_000


def write_ros2(folder: Path, log_s: int, *stamps_s: int) -> None:
    store = ros2_store()
    with rosbag2.Writer(folder, version=9) as writer:
        fix = writer.add_connection("/fix", "sensor_msgs/msg/NavSatFix", typestore=store)
        for index, stamp_s in enumerate(stamps_s):
            message = samples.nav_sat_fix(store, stamp_s * S)
            writer.write(fix, log_s * S + index, store.serialize_cdr(message, fix.msgtype))


def test_messages_after_2106_do_not_fit_into_a_ros_1_bag(tmp_path: Path) -> None:
    write_ros2(tmp_path / "late", IN_2109, IN_2026, IN_2026)
    result = convert(tmp_path / "late", tmp_path / "late.bag")
    assert (result.messages_in, result.messages_out, result.skipped) == (2, 0, {"/fix": 2})
    why = "recorded in the year 2109, and this format holds 1970 to 2106; check the clock"
    assert result.reasons["/fix"].startswith(why)
    kept = convert(tmp_path / "late", tmp_path / "late.mcap")
    assert not kept.skipped
    times_ns = [log_ns for log_ns, _ in samples.values(tmp_path / "late.mcap")["/fix"]]
    assert times_ns == [IN_2109 * S, IN_2109 * S + 1]


@pytest.mark.parametrize("stamp_s", [-86401, -(1 << 31)])
def test_a_stamp_before_1970_does_not_become_one_of_2106_in_ros_1(
    tmp_path: Path, stamp_s: int
) -> None:
    write_ros2(tmp_path / "early", IN_2026, IN_2026, stamp_s)
    result = convert(tmp_path / "early", tmp_path / "early.bag")
    assert (result.messages_out, result.skipped) == (1, {"/fix": 1})
    assert "only one version of ROS can hold" in result.reasons["/fix"]
    assert not convert(tmp_path / "early", tmp_path / "early.mcap").skipped


def test_a_stamp_after_2038_does_not_become_one_of_1904_in_ros_2(tmp_path: Path) -> None:
    store = ros1_store()
    with rosbag1.Writer(tmp_path / "late.bag") as writer:
        fix = writer.add_connection("/fix", "sensor_msgs/msg/NavSatFix", typestore=store)
        for stamp_s in (IN_2026, IN_2040 - (1 << 32)):  # its bits: the library knows a sign
            message = samples.nav_sat_fix(store, stamp_s * S)
            writer.write(fix, IN_2040 * S, store.serialize_ros1(message, fix.msgtype))
    result = convert(tmp_path / "late.bag", tmp_path / "late.mcap")
    assert (result.messages_out, result.skipped) == (1, {"/fix": 1})
    assert "after January 2038" in result.reasons["/fix"]
    assert not convert(tmp_path / "late.bag", tmp_path / "copy.bag").skipped
