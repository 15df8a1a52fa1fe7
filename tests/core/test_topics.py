from __future__ import annotations

import json
import re
from pathlib import Path

import msgspec
from rosbags.typesys import Stores, get_typestore

from agribot.core import topics
from agribot.core.messages import SensorBatch

JAZZY = get_typestore(Stores.ROS2_JAZZY)
SEED_NAMES = (
    "/agribot/fix", "/agribot/fix_velocity", "/agribot/cmd_vel", "/agribot/imu", "/agribot/odom",
    "/agribot/camera/image_raw", "/agribot/joint_states", "/magnetic", "/distance", "/angle",
    "/angleOG", "/Rawheading", "/Filteredheading", "/currentPose", "/goal_GPS",
    "/Pole/fix", "/odom", "/joint_states", "/Pole/fix_velocity", "/calibrated", "/agribot/imu/bias",
)  # fmt: skip


GOLDEN = Path(__file__).parents[1] / "golden"


def _golden(name: str) -> dict[str, str]:
    """Hashes of our message types as real ROS tools print them."""
    hashes = json.loads((GOLDEN / name).read_text())["hashes"]
    assert isinstance(hashes, dict)
    return hashes


def test_names_are_unique_and_valid_in_ros() -> None:
    names = [topic.name for topic in topics.TOPICS]
    assert len(names) == len(set(names))
    assert all(re.fullmatch(r"(/[a-z][a-z0-9_]*)+", name) for name in names)


def test_every_ros_type_exists_in_jazzy() -> None:
    for topic in topics.TOPICS:
        if topic is topics.EXTENDED_FIX:  # of a package that no ROS brings with it
            continue
        if topic.ros_type:
            assert JAZZY.get_msgdef(topic.ros_type).name == topic.ros_type
        if topic.seed_ros_type:
            assert JAZZY.get_msgdef(topic.seed_ros_type).name == topic.seed_ros_type


def test_every_topic_of_the_original_has_a_successor() -> None:
    for name in SEED_NAMES:
        topic = topics.find_topic(name)
        assert topic is not None, name
        assert topic.seed_ros_type, name


def test_a_name_is_found_before_an_alias() -> None:
    assert topics.find_topic("/agribot/fix") is topics.FIX
    assert topics.find_topic("/magnetic") is topics.MAGNETIC
    assert topics.find_topic("/no/such/topic") is None


def test_every_sensor_of_a_batch_has_a_topic() -> None:
    carried = {topic.struct for topic in topics.TOPICS}
    for field in msgspec.structs.fields(SensorBatch):
        # Requests, headings, other sensors and reports of boards travel inside /agribot/tick.
        if field.name in {
            "t_s", "requests", "notes", "headings", "hand", "others", "board", "gnss_status",
            "contactor", "obstacles",
        }:  # fmt: skip
            continue
        sample = field.type.__args__[0]
        assert sample in carried, field.name


def test_what_a_late_subscriber_needs_is_latched() -> None:
    for topic in (topics.TF_STATIC, topics.ROBOT_DESCRIPTION, topics.PATH, topics.GOALS):
        assert topic.qos.latched
        assert topic.rate_hz is None


def test_type_hashes_are_those_of_ros2_jazzy() -> None:
    golden = _golden("ros2-jazzy-rihs01.json")
    compared = [t.ros_type for t in topics.TOPICS if t.ros_type in golden]
    assert len(set(compared)) >= 10
    for ros_type in compared:
        assert JAZZY.hash_rihs01(ros_type) == golden[ros_type]


def test_md5_sums_are_those_of_ros1() -> None:
    golden = _golden("ros1-md5.json")
    noetic = get_typestore(Stores.ROS1_NOETIC)
    compared = 0
    for ros_type in {t.seed_ros_type or t.ros_type for t in topics.TOPICS}:
        ros1_name = ros_type.replace("/msg/", "/")
        if ros1_name in golden and ros_type in noetic.types:
            _, md5 = noetic.generate_msgdef(ros_type, ros_version=1)
            assert md5 == golden[ros1_name], ros1_name
            compared += 1
    assert compared >= 10
