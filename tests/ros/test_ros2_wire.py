"""Byte for byte what rmw_zenoh 0.2.10 of ROS 2 Jazzy puts on the wire."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import pytest
import xxhash

from agribot.core import topics
from agribot.core.topics import LATCHED, LATEST, STREAM, Qos
from agribot.ros.messages.rosmsg import load_types
from agribot.ros.ros2 import wire
from agribot.ros.ros2.services import EVENT_INFO, ActionText, add_action, load_service_types

GOLDEN = Path(__file__).parents[1] / "golden" / "ros2-services-rihs01.json"
LOOKUP = ActionText(
    "string target_frame\nstring source_frame\nbuiltin_interfaces/Time source_time\n"
    "builtin_interfaces/Duration timeout\nbuiltin_interfaces/Time target_time\n"
    "string fixed_frame\nbool advanced\n",
    "geometry_msgs/TransformStamped transform\ntf2_msgs/TF2Error error\n",
    "",
)
FIX_HASH = "RIHS01_62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404"
NODE = wire.NodeName(domain=0, zid="aac3178e146ba6f1fc6e6a4085e77f21", name="agribot")


def test_a_topic_key_names_domain_type_and_hash() -> None:
    assert wire.make_topic_key(7, "/agribot/fix", "sensor_msgs/msg/NavSatFix", FIX_HASH) == (
        f"7/agribot/fix/sensor_msgs::msg::dds_::NavSatFix_/{FIX_HASH}"
    )
    assert load_types().hash_rihs01("sensor_msgs/msg/NavSatFix") == FIX_HASH


def test_tokens_of_node_and_endpoint_are_those_of_rmw_zenoh() -> None:
    zid = NODE.zid
    assert NODE.make_token() == f"@ros2_lv/0/{zid}/0/0/NN/%/%/agribot"
    token = NODE.make_endpoint_token(
        3, "MP", "/agribot/fix", "sensor_msgs/msg/NavSatFix", FIX_HASH, STREAM
    )
    assert token == (
        f"@ros2_lv/0/{zid}/0/3/MP/%/%/agribot/%agribot%fix/"
        f"sensor_msgs::msg::dds_::NavSatFix_/{FIX_HASH}/::,10:,:,:,,"
    )
    peer = wire.read_endpoint(token)
    assert peer == ("agribot", "MP", "/agribot/fix", "sensor_msgs::msg::dds_::NavSatFix_")


@pytest.mark.parametrize(
    ("qos", "text"),
    [
        (STREAM, "::,10:,:,:,,"),
        (LATCHED, ":1:,1:,:,:,,"),
        (LATEST, "2::,1:,:,:,,"),
        (Qos(reliable=False, depth=5), "2::,5:,:,:,,"),
        (Qos(depth=42), "::,:,:,:,,"),  # 42 is the default of rmw_zenoh, which goes unsaid
    ],
)
def test_qos_says_only_what_differs_from_the_defaults(qos: Qos, text: str) -> None:
    assert wire.format_qos(qos) == text


def test_the_gid_is_the_hash_of_the_token() -> None:
    token = NODE.make_token()
    # The digest in canonical order is big-endian; rmw_zenoh copies the low half first.
    canonical = xxhash.xxh3_128_digest(token.encode())
    assert wire.compute_gid(token) == canonical[:7:-1] + canonical[7::-1]
    # XXH3-128 of nothing is 99aa06d3014798d8 6001c324468d497f (test vector of xxHash).
    assert wire.compute_gid("") == bytes.fromhex("7f498d4624c30160" + "d8984701d306aa99")


def test_an_attachment_is_sequence_stamp_and_gid_in_33_bytes() -> None:
    gid = bytes(range(16))
    data = wire.pack_attachment(5, 1_700_000_000_123_456_789, gid)
    assert data.hex() == (
        "0500000000000000" + struct.pack("<q", 1_700_000_000_123_456_789).hex() + "10" + gid.hex()
    )
    assert len(data) == 33
    assert wire.read_attachment(data) == (5, 1_700_000_000_123_456_789, gid)
    for broken in (b"", data[:-1], data + b"\0", data[:16] + b"\x0f" + data[17:]):
        assert wire.read_attachment(broken) is None


@pytest.mark.parametrize("token", ["", "@ros2_lv/0", "x/" * 12, NODE.make_token()])
def test_a_token_that_is_no_endpoint_is_nobody(token: str) -> None:
    assert wire.read_endpoint(token) is None


def test_hashes_of_services_and_actions_are_those_of_ros2_jazzy() -> None:
    golden = json.loads(GOLDEN.read_text())["hashes"]
    store = load_service_types()
    add_action(store, "tf2_msgs/action/LookupTransform", LOOKUP)
    assert len(golden) == 53
    assert EVENT_INFO in golden
    for name, value in golden.items():
        assert store.hash_rihs01(name) == value, name


def test_every_topic_has_a_key_of_its_own() -> None:
    keys = {
        wire.make_topic_key(0, t.name, t.ros_type, load_types().hash_rihs01(t.ros_type))
        for t in topics.TOPICS
        if t.ros_type
    }
    assert len(keys) == sum(bool(t.ros_type) for t in topics.TOPICS)
    assert all("RIHS01_" in key and not key.startswith("/") for key in keys)
