from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from agribot.record.bag.definitions import (
    make_transcoder,
    name_in_ros1,
    name_in_ros2,
    ros1_store,
    ros2_store,
)
from agribot.ros.messages.gps_types import read_shipped_texts
from tests.record.bag import bag_samples

MARTI = (
    "marti_common_msgs/KeyValue",
    "marti_common_msgs/StringStamped",
    "marti_common_msgs/Float32Stamped",
    "marti_common_msgs/Float64Stamped",
    "marti_sensor_msgs/Velocity",
    "marti_nav_msgs/Route",
    "marti_nav_msgs/RoutePoint",
    "marti_nav_msgs/RoutePosition",
    "marti_visualization_msgs/TexturedMarker",
    "marti_visualization_msgs/TexturedMarkerArray",
)
GPS = ("gps_common/GPSFix", "gps_common/GPSStatus")
# rosbags hashes `char` as itself, ROS as uint8; none of these is a type of a recording.
WITH_CHAR = {
    "rmw_dds_common/msg/Gid",
    "rmw_dds_common/msg/NodeEntitiesInfo",
    "rmw_dds_common/msg/ParticipantEntitiesInfo",
    "service_msgs/msg/ServiceEventInfo",
    "std_msgs/msg/Char",
}


def golden(name: str) -> dict[str, str]:
    folder = os.environ.get("AGRIBOT_DATA")
    if not folder:
        pytest.skip("AGRIBOT_DATA is not set")
    path = Path(folder) / "interop-golden" / name
    if not path.exists():
        pytest.skip(f"{path.name} is not there")
    loaded: dict[str, str] = json.loads(path.read_text())
    return loaded


def test_the_types_of_the_original_tools_are_shipped() -> None:
    shipped = {name.replace("/msg/", "/") for name in read_shipped_texts()}
    assert {*MARTI, *GPS} <= shipped


def test_md5_sums_are_those_of_ros_1() -> None:
    known = golden("ros1-md5.json")
    store = ros1_store()
    ours = [name for name in known if name.replace("/", "/msg/") in store.fielddefs]
    assert {*MARTI, *GPS, "tf2_msgs/TFMessage"} <= set(ours)
    assert len(ours) > 150
    for name in ours:
        assert store.generate_msgdef(name.replace("/", "/msg/"))[1] == known[name], name


def test_type_hashes_are_those_of_ros_2() -> None:
    known = golden("ros2-jazzy-rihs01.json")
    store = ros2_store()
    ours = [name for name in known if name in store.fielddefs and name not in WITH_CHAR]
    assert len(ours) > 120
    for name in ours:
        assert store.hash_rihs01(name) == known[name], name


def test_gps_types_have_another_package_in_ros_2() -> None:
    assert name_in_ros2("gps_common/msg/GPSFix") == "gps_msgs/msg/GPSFix"
    assert name_in_ros1("gps_msgs/msg/GPSFix") == "gps_common/msg/GPSFix"
    assert name_in_ros2("tf/msg/tfMessage") == "tf2_msgs/msg/TFMessage"
    assert name_in_ros2("sensor_msgs/msg/Imu") == "sensor_msgs/msg/Imu"


def test_a_textured_marker_is_the_same_after_both_ros_versions() -> None:
    one, two = ros1_store(), ros2_store()
    make = two.types
    pose = make["geometry_msgs/msg/Pose"](
        make["geometry_msgs/msg/Point"](1.0, 2.0, 3.0),
        make["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
    )
    pixels = np.arange(12, dtype=np.uint8)
    head = bag_samples.header(two, 5_000_000_007, "map")
    image = make["sensor_msgs/msg/Image"](head, 2, 2, "rgb8", 0, 6, pixels)
    lifetime = make["builtin_interfaces/msg/Duration"](3, 4)
    name = "marti_visualization_msgs/msg/TexturedMarker"
    marker = make[name](head, "tiles", 7, 0, lifetime, image, pose, 0.25, 0.5)
    wire = bytes(two.serialize_cdr(marker, name))
    to_one = make_transcoder(two, name, True, one, name, False)
    to_two = make_transcoder(one, name, False, two, name, True)
    assert to_two(to_one(wire)) == wire
    # ROS 1 by hand: seq, stamp, frame, then namespace, id, action.
    head_bytes = b"\0\0\0\0" + b"\5\0\0\0" + b"\7\0\0\0" + b"\3\0\0\0map"
    assert to_one(wire).startswith(head_bytes + b"\5\0\0\0tiles" + b"\7\0\0\0" + b"\0\0\0\0")
