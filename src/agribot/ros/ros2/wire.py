"""What rmw_zenoh puts on the wire: keys, liveliness tokens and attachments, byte for byte.

Source: the design document and source of rmw_zenoh_cpp 0.2 (Jazzy), 0.6 (Kilted), 0.10 (Lyrical),
which share this format.
"""

from __future__ import annotations

import struct
from typing import Literal, NamedTuple

import msgspec

from agribot.core.topics import Qos

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

    def token(self) -> str:
        return (
            f"{ADMIN_SPACE}/{self.domain}/{self.zid}/{self.node_id}/{self.node_id}/NN/%/"
            f"{mangled(self.namespace)}/{self.name}"
        )

    def endpoint_token(
        self, entity_id: int, kind: EntityKind, name: str, ros_type: str, type_hash: str, qos: Qos
    ) -> str:
        return (
            f"{ADMIN_SPACE}/{self.domain}/{self.zid}/{self.node_id}/{entity_id}/{kind}/%/"
            f"{mangled(self.namespace)}/{self.name}/{mangled(name)}/{dds_type(ros_type)}/"
            f"{type_hash}/{qos_text(qos)}"
        )


class Endpoint(NamedTuple):
    """What another node says of itself in a liveliness token."""

    node: str
    kind: str
    name: str
    type_name: str


def mangled(name: str) -> str:
    return name.replace("/", "%")


def dds_type(ros_type: str) -> str:
    """`sensor_msgs/msg/Imu` -> `sensor_msgs::msg::dds_::Imu_`."""
    package, kind, name = ros_type.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def read_topic_key(key: str) -> tuple[str, str] | None:
    """ROS type and type hash of a topic's key; None where it is none."""
    *_, name, type_hash = key.split("/")
    parts = name.split("::")
    if len(parts) != 4 or parts[2] != "dds_":
        return None
    return f"{parts[0]}/{parts[1]}/{parts[3].removesuffix('_')}", type_hash


def topic_key(domain: int, name: str, ros_type: str, type_hash: str) -> str:
    return f"{domain}/{name.strip('/')}/{dds_type(ros_type)}/{type_hash}"


def qos_text(qos: Qos) -> str:
    """Reliability : durability : history,depth : deadline : lifespan : liveliness."""
    reliability = "" if qos.reliable else "2"
    durability = "1" if qos.latched else ""
    depth = "" if qos.depth == _DEFAULT_DEPTH else str(qos.depth)
    return f"{reliability}:{durability}:,{depth}:,:,:,,"


def gid_of(token: str) -> bytes:
    """The id that messages of an endpoint carry: XXH3-128 of its token, low half first."""
    import xxhash

    digest = xxhash.xxh3_128_intdigest(token.encode())
    return struct.pack("<QQ", digest & (2**64 - 1), digest >> 64)


def pack_attachment(sequence: int, source_ns: int, gid: bytes) -> bytes:
    return _ATTACHMENT.pack(sequence, source_ns, GID_SIZE, gid)


def read_attachment(data: bytes) -> Attachment | None:
    """None when it is not what rmw_zenoh sends."""
    if len(data) != _ATTACHMENT.size:
        return None
    sequence, source_ns, size, gid = _ATTACHMENT.unpack(data)
    return Attachment(sequence, source_ns, gid) if size == GID_SIZE else None


def read_endpoint(token: str) -> Endpoint | None:
    """None for a token of something else than an endpoint."""
    parts = token.split("/")
    if len(parts) < 12 or parts[0] != ADMIN_SPACE:
        return None
    return Endpoint(parts[8], parts[5], parts[9].replace("%", "/"), parts[10])
