"""A ROS 2 program on DDS in a process of its own: its types written by hand, no AGRIBOT code.

Reads one JSON command per line, answers each with one JSON line.
"""

# mypy: disable-error-code="type-arg,valid-type,misc,no-untyped-call"
# Annotations must be objects here, not strings: the types are made of them.
import json
import sys
from dataclasses import dataclass
from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import (
    array,
    bounded_str,
    float64,
    int8,
    int32,
    int64,
    sequence,
    uint8,
    uint16,
    uint32,
    uint64,
)
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

MSG = "{}::msg::dds_::{}_"


@final
@dataclass
class Time(IdlStruct, typename=MSG.format("builtin_interfaces", "Time")):
    sec: int32
    nanosec: uint32


@final
@dataclass
class Header(IdlStruct, typename=MSG.format("std_msgs", "Header")):
    stamp: Time
    frame_id: str


@final
@dataclass
class Status(IdlStruct, typename=MSG.format("sensor_msgs", "NavSatStatus")):
    status: int8
    service: uint16


@final
@dataclass
class Fix(IdlStruct, typename=MSG.format("sensor_msgs", "NavSatFix")):
    header: Header
    status: Status
    latitude: float64
    longitude: float64
    altitude: float64
    position_covariance: array[float64, 9]
    position_covariance_type: uint8


@final
@dataclass
class Image(IdlStruct, typename=MSG.format("sensor_msgs", "Image")):
    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


@final
@dataclass
class String(IdlStruct, typename=MSG.format("std_msgs", "String")):
    data: str


@final
@dataclass
class Vector3(IdlStruct, typename=MSG.format("geometry_msgs", "Vector3")):
    x: float64
    y: float64
    z: float64


@final
@dataclass
class Twist(IdlStruct, typename=MSG.format("geometry_msgs", "Twist")):
    linear: Vector3
    angular: Vector3


@final
@dataclass
class Point(IdlStruct, typename=MSG.format("geometry_msgs", "Point")):
    x: float64
    y: float64
    z: float64


@final
@dataclass
class Quaternion(IdlStruct, typename=MSG.format("geometry_msgs", "Quaternion")):
    x: float64
    y: float64
    z: float64
    w: float64


@final
@dataclass
class Pose(IdlStruct, typename=MSG.format("geometry_msgs", "Pose")):
    position: Point
    orientation: Quaternion


@final
@dataclass
class PoseStamped(IdlStruct, typename=MSG.format("geometry_msgs", "PoseStamped")):
    header: Header
    pose: Pose


@final
@dataclass
class PauseRequest(IdlStruct, typename="std_srvs::srv::dds_::SetBool_Request_"):
    client: uint64
    number: int64
    data: bool


@final
@dataclass
class PauseResponse(IdlStruct, typename="std_srvs::srv::dds_::SetBool_Response_"):
    client: uint64
    number: int64
    success: bool
    message: str


@final
@dataclass
class Gid(IdlStruct, typename=MSG.format("rmw_dds_common", "Gid")):
    data: array[uint8, 16]


@final
@dataclass
class Node(IdlStruct, typename=MSG.format("rmw_dds_common", "NodeEntitiesInfo")):
    node_namespace: bounded_str[256]
    node_name: bounded_str[256]
    reader_gid_seq: sequence[Gid]
    writer_gid_seq: sequence[Gid]


@final
@dataclass
class Entities(IdlStruct, typename=MSG.format("rmw_dds_common", "ParticipantEntitiesInfo")):
    gid: Gid
    node_entities_info_seq: sequence[Node]


VOLATILE = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.History.KeepLast(10),
    Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
)
LATCHED = Qos(Policy.Durability.TransientLocal, base=VOLATILE)


LOCAL = """<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>60</MaxAutoParticipantIndex><Peers><Peer Address="127.0.0.1"/></Peers>
</Discovery></Domain></CycloneDDS>"""  # what ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST does


class Peer:
    def __init__(self, domain: int) -> None:
        self.domain = Domain(domain, LOCAL)
        self.participant = DomainParticipant(domain)
        self.fix = self.reader("rt/agribot/fix", Fix, VOLATILE)
        self.image = self.reader("rt/agribot/camera/image_raw", Image, VOLATILE)
        self.description = self.reader("rt/robot_description", String, LATCHED)
        self.nodes = self.reader("ros_discovery_info", Entities, LATCHED)
        twist = Topic(self.participant, "rt/agribot/cmd_vel", Twist, qos=VOLATILE)
        self.cmd_vel = DataWriter(self.participant, twist, qos=VOLATILE)
        self.commands = self.writer("rt/agribot/command", String)
        self.goals = self.writer("rt/goal_pose", PoseStamped)
        self.pauses = self.writer("rq/agribot/pauseRequest", PauseRequest)
        self.paused = self.reader("rr/agribot/pauseReply", PauseResponse, VOLATILE)
        self.publications: Any = BuiltinDataReader(self.participant, BuiltinTopicDcpsPublication)
        self.seen: dict[str, str] = {}

    def reader(self, name: str, kind: Any, qos: Qos) -> Any:
        return DataReader(self.participant, Topic(self.participant, name, kind, qos=qos), qos=qos)

    def writer(self, name: str, kind: Any) -> Any:
        topic = Topic(self.participant, name, kind, qos=VOLATILE)
        return DataWriter(self.participant, topic, qos=VOLATILE)

    def fixes(self) -> list[Any]:
        return [
            [m.header.stamp.sec, m.header.stamp.nanosec, m.header.frame_id, m.latitude,
             m.longitude, list(m.position_covariance)]
            for m in self.fix.take(100)
        ]  # fmt: skip

    def images(self) -> list[Any]:
        return [
            [m.height, m.width, m.encoding, len(m.data),
             sum((k % 251 + 1) * byte for k, byte in enumerate(m.data))]
            for m in self.image.take(10)
        ]  # fmt: skip

    def descriptions(self) -> list[str]:
        return [message.data for message in self.description.take(10)]

    def node_names(self) -> list[Any]:
        return [
            [node.node_name, len(node.reader_gid_seq), len(node.writer_gid_seq)]
            for message in self.nodes.take(100)
            for node in message.node_entities_info_seq
        ]

    def hashes(self) -> dict[str, str]:
        for seen in self.publications.take(200):
            user = seen.qos[Policy.Userdata] if seen.qos and Policy.Userdata in seen.qos else None
            self.seen[seen.topic_name] = user.data.decode() if user else ""
        return self.seen

    def twist(self, v_mps: float, yaw_rate_radps: float) -> int:
        zero = (0.0, 0.0)
        self.cmd_vel.write(Twist(Vector3(v_mps, *zero), Vector3(*zero, yaw_rate_radps)))
        return len(self.cmd_vel.get_matched_subscriptions())

    def command(self, text: str) -> int:
        self.commands.write(String(text))
        return len(self.commands.get_matched_subscriptions())

    def goal(self, frame: str, x: float, y: float) -> int:
        pose = Pose(Point(x, y, 0.0), Quaternion(0.0, 0.0, 0.0, 0.0))
        self.goals.write(PoseStamped(Header(Time(0, 0), frame), pose))
        return len(self.goals.get_matched_subscriptions())

    def pauses_are_heard(self) -> int:
        return len(self.pauses.get_matched_subscriptions())

    def pause(self, client: int, number: int) -> None:
        self.pauses.write(PauseRequest(client, number, True))

    def answers(self) -> list[Any]:
        return [[a.client, a.number, a.success, a.message] for a in self.paused.take(10)]


def main() -> None:
    peer = Peer(int(sys.argv[1]))
    say("ready")
    for line in sys.stdin:
        method, *arguments = json.loads(line)
        say(getattr(peer, method)(*arguments))


def say(value: object) -> None:
    sys.stdout.write(json.dumps(value) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
