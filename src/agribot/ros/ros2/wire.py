"""The wire format of rmw_zenoh: keys, liveliness tokens and attachments, byte for byte.

Source: the design document and source of rmw_zenoh_cpp 0.2 (Jazzy), 0.6 (Kilted), 0.10 (Lyrical),
which share this format.
"""

from __future__ import annotations

import struct
from typing import Literal, NamedTuple

import msgspec

from agribot.core.topics import Qos
from agribot.ros.messages.dds_names import from_dds_name, to_dds_name

ADMIN_SPACE = "@ros2_lv"
GID_SIZE = 16
_DEFAULT_DEPTH = 42  # rmw_zenoh leaves out what equals its own default
_ATTACHMENT = struct.Struct("<qqB16s")

EntityKind = Literal["MP", "MS", "SS", "SC"]  # publisher, subscription, service, client


class Attachment(NamedTuple):
    sequence: int
    source_ns: int
    gid: bytes


class NodeName(msgspec.Struct, frozen=True, kw_only=True):
    """A node in one session: `zid` is the session's id in hexadecimal."""

    domain: int
    zid: str
    name: str
    namespace: str = "/"
    node_id: int = 0

    def make_token(self) -> str:
        return (
            f"{ADMIN_SPACE}/{self.domain}/{self.zid}/{self.node_id}/{self.node_id}/NN/%/"
            f"{mangle(self.namespace)}/{self.name}"
        )

    def make_endpoint_token(
        self, entity_id: int, kind: EntityKind, name: str, ros_type: str, type_hash: str, qos: Qos
    ) -> str:
        return (
            f"{ADMIN_SPACE}/{self.domain}/{self.zid}/{self.node_id}/{entity_id}/{kind}/%/"
            f"{mangle(self.namespace)}/{self.name}/{mangle(name)}/{to_dds_name(ros_type)}/"
            f"{type_hash}/{format_qos(qos)}"
        )


class Endpoint(NamedTuple):
    """An endpoint of another node, from its liveliness token."""

    node: str
    kind: str
    name: str
    type_name: str


class FoundPublisher(NamedTuple):
    """A publisher of another node, from its liveliness token."""

    node: str
    name: str
    ros_type: str
    type_hash: str
    is_reliable: bool
    is_latched: bool


def mangle(name: str) -> str:
    return name.replace("/", "%")


def read_topic_key(key: str) -> tuple[str, str] | None:
    """Read ROS type and type hash of a topic's key; None if it is no topic's."""
    *_, name, type_hash = key.split("/")
    ros_type = from_dds_name(name)
    return (ros_type, type_hash) if ros_type else None


def make_topic_key(domain: int, name: str, ros_type: str, type_hash: str) -> str:
    return f"{domain}/{name.strip('/')}/{to_dds_name(ros_type)}/{type_hash}"


def format_qos(qos: Qos) -> str:
    """Format reliability : durability : history,depth : deadline : lifespan : liveliness."""
    reliability = "" if qos.reliable else "2"
    durability = "1" if qos.latched else ""
    depth = "" if qos.depth == _DEFAULT_DEPTH else str(qos.depth)
    return f"{reliability}:{durability}:,{depth}:,:,:,,"


def compute_gid(token: str) -> bytes:
    """Compute the id in the messages of an endpoint: XXH3-128 of its token, low half first."""
    import xxhash

    digest = xxhash.xxh3_128_intdigest(token.encode())
    return struct.pack("<QQ", digest & (2**64 - 1), digest >> 64)


def pack_attachment(sequence: int, source_ns: int, gid: bytes) -> bytes:
    return _ATTACHMENT.pack(sequence, source_ns, GID_SIZE, gid)


def read_attachment(data: bytes) -> Attachment | None:
    """Read an attachment; None if it is not one of rmw_zenoh."""
    if len(data) != _ATTACHMENT.size:
        return None
    sequence, source_ns, size, gid = _ATTACHMENT.unpack(data)
    return Attachment(sequence, source_ns, gid) if size == GID_SIZE else None


def read_endpoint(token: str) -> Endpoint | None:
    """Read the endpoint of a token; None if it is no endpoint's."""
    parts = token.split("/")
    if len(parts) < 12 or parts[0] != ADMIN_SPACE:
        return None
    return Endpoint(parts[8], parts[5], parts[9].replace("%", "/"), parts[10])


def read_publisher(token: str) -> FoundPublisher | None:
    """Read the publisher of a token; None if it is no publisher's."""
    parts = token.split("/")
    if len(parts) < 13 or parts[0] != ADMIN_SPACE or parts[5] != "MP":
        return None
    ros_type = from_dds_name(parts[10])
    reliability, durability, *_ = [*parts[12].split(":"), "", ""]
    name = parts[9].replace("%", "/")
    return FoundPublisher(
        read_node_name(token), name, ros_type, parts[11], reliability != "2", durability == "1"
    )


def read_node_name(token: str) -> str:
    """Read the node of a node's or an endpoint's token, with its namespace; "" if it has none."""
    parts = token.split("/")
    if len(parts) < 9 or parts[0] != ADMIN_SPACE:
        return ""
    return f"{parts[7].replace('%', '/').rstrip('/')}/{parts[8]}"
