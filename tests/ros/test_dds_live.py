"""A run on DDS: another process, with types of its own, hears it and may drive it.

That is a program on Cyclone DDS, and one on Fast DDS, which shares no code with ours, as ROS 2
sets it up unasked, with ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST and with ROS_LOCALHOST_ONLY=1.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from agribot.core import topics
from agribot.core.inbound_topics import INBOUND_TOPICS
from agribot.core.messages import AskerKind, GnssFix, GnssQuality, GoTo, Inbox, RequestEvent, Who
from agribot.ros.dds.gateway import DdsGateway
from agribot.ros.dds.types import load_dds_types, make_dds_type
from agribot.ros.messages import rosmsg
from agribot.ros.messages.dds_names import to_dds_name
from agribot.ros.requests import SERVICES, Requests
from tests import machine, nightly
from tests.ros.live import Talk, first, peer, program
from tests.waiting import wait_for

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")

OUT = [topic for topic in topics.TOPICS if topic.ros_type and topic is not topics.CMD_VEL]
ACTIONS = 2
# Services: commands, pause, pose and route; six of the parameters, and three of each action.
SERVED = len(SERVICES) + 3 + 6 + 3 * ACTIONS
ABOUT_GOALS = 2 * ACTIONS  # topics
GOLDEN = Path(__file__).parents[1] / "golden" / "ros2-jazzy-rihs01.json"


class Robot:
    def __init__(self, domain: int) -> None:
        self.inbox, self.said = Inbox(), list[str]()
        requests = Requests(self.inbox, allow_drive=True, report=self.said.append)
        self.gateway = DdsGateway(requests, OUT, domain=domain)
        description = rosmsg.to_cdr(rosmsg.make_text("<robot/>"))
        self.gateway.publish(topics.ROBOT_DESCRIPTION, description, 0)

    def close(self) -> None:
        self.gateway.close()


@pytest.fixture(scope="module")
def fastdds_peer(tmp_path_factory: pytest.TempPathFactory) -> str:
    if machine.find("g++") is None or not Path("/usr/include/fastdds").is_dir():
        pytest.skip(machine.missing("g++"))
    made = tmp_path_factory.mktemp("fastdds") / "peer"
    source = Path(__file__).with_name("fastdds_peer.cpp")
    libraries = ("-lfastrtps", "-lfastcdr")
    subprocess.run(["g++", "-std=c++17", str(source), "-o", str(made), *libraries], check=True)
    return str(made)


PEERS = ["cyclone", "subnet", "localhost", "localhost-only"]


@pytest.fixture(
    scope="module",
    params=[
        "cyclone",
        *(
            pytest.param(
                name, marks=nightly.by_day("test_a_fix_arrives_exactly_in_the_peers_own_type")
            )
            for name in PEERS[1:]
        ),
    ],
)
def live(request: pytest.FixtureRequest) -> Iterator[tuple[Robot, Talk]]:
    # Not that of another test run on this machine, nor that of the peer before.
    domain = 20 + os.getpid() % 20 + 20 * PEERS.index(request.param)
    with closing(Robot(domain)) as robot:
        if request.param == "cyclone":
            other = peer("dds_peer.py", str(domain))
        else:
            made: str = request.getfixturevalue("fastdds_peer")
            other = program(made, str(domain), request.param)
        with other as talk:
            yield robot, talk


def test_a_late_peer_gets_the_description_and_sees_the_node(live: tuple[Robot, Talk]) -> None:
    _, talk = live
    assert first(lambda: talk("descriptions"), "the description") == "<robot/>"
    nodes: list[list[object]] = []

    def is_known() -> bool:
        nodes.extend(talk("node_names"))
        published = sum(len(topic.names) for topic in OUT)
        readers, writers = 1 + len(INBOUND_TOPICS) + SERVED, published + SERVED + ABOUT_GOALS
        return ["agribot", readers, writers] in nodes

    wait_for(is_known, "the node with all its endpoints")


def test_a_fix_arrives_exactly_in_the_peers_own_type(live: tuple[Robot, Talk]) -> None:
    robot, talk = live
    fix = GnssFix(
        t_s=12.25, lat_deg=21.5, lon_deg=-72.25, alt_m=3.0, pos_std_m=2.0,
        quality=GnssQuality.RTK_FIXED,
    )  # fmt: skip
    data = rosmsg.to_cdr(rosmsg.make_fix(fix, "gps_link"))

    def said_and_heard() -> list[object]:
        robot.gateway.publish(topics.FIX, data, 0)
        heard: list[object] = talk("fixes")
        return heard

    covariance = [4.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 16.0]
    got = first(said_and_heard, "a fix")
    assert got == [12, 250_000_000, "gps_link", 21.5, -72.25, covariance]


def test_an_image_arrives_whole(live: tuple[Robot, Talk]) -> None:
    """0.9 MB in 15 fragments."""
    robot, talk = live
    pixels = np.random.default_rng(1).integers(0, 256, (480, 640, 3), np.uint8)
    data = rosmsg.to_cdr(rosmsg.make_image(1.0, pixels))
    weights = np.arange(pixels.size) % 251 + 1

    def said_and_heard() -> list[object]:
        robot.gateway.publish(topics.IMAGE_RAW, data, 0)
        heard: list[object] = talk("images")
        return heard

    got = first(said_and_heard, "an image")
    assert got == [480, 640, "rgb8", pixels.size, int((weights * pixels.ravel()).sum())]


def test_every_topic_is_announced_with_the_hash_that_ros_prints(live: tuple[Robot, Talk]) -> None:
    _, talk = live
    golden = json.loads(GOLDEN.read_text())["hashes"]
    wait_for(lambda: {f"rt{t.name}" for t in OUT} <= set(talk("hashes")), "all topics")
    hashes = talk("hashes")
    compared = [topic for topic in OUT if topic.ros_type in golden]
    assert len(compared) > 20
    for topic in compared:
        assert hashes[f"rt{topic.name}"] == f"typehash={golden[topic.ros_type]};"


def test_a_twist_of_the_peer_reaches_the_inbox_exactly(live: tuple[Robot, Talk]) -> None:
    robot, talk = live

    def driven() -> list[tuple[float, float]]:
        talk("twist", 0.25, -0.5)
        return [(h.v_mps, h.yaw_rate_radps) for h in robot.inbox.drain(1.0)[1]]

    assert first(driven, "a twist") == (0.25, -0.5)
    # What waited for the discovery may come in one burst, which is thinned out.
    assert [text for text in robot.said if "faster than" not in text] == []


def test_commands_and_goals_of_a_peer_reach_the_inbox() -> None:
    domain = 100 + os.getpid() % 20
    with closing(Robot(domain)) as robot, peer("dds_peer.py", str(domain)) as talk:

        def ask(action: str, *request: object) -> list[RequestEvent]:
            """Send a request until it arrives; those sent before may arrive later, too."""
            talk(*request)
            return [event for event in robot.inbox.drain(1.0)[0] if event.request.word == action]

        assert first(lambda: ask("stop", "command", "stop"), "a command").who.name == "DDS"
        goal = first(lambda: ask("goto", "goal", "map", 2.5, -1.0), "a goal")
        assert goal.request == GoTo(id=goal.request.id, x_map_m=2.5, y_map_m=-1.0)
        assert goal.who == Who("DDS", AskerKind.ROS)
        refusal = "frame 'moon' is unknown; use one of map, odom, wgs84"

        def is_refused() -> bool:
            talk("goal", "moon", 0.0, 0.0)
            return any(refusal in text for text in robot.said)

        wait_for(is_refused, "the refusal")


def test_a_client_knows_the_answer_to_its_request_by_its_marks() -> None:
    """As rmw_cyclonedds carries them, one answer for each request."""
    domain = 100 + os.getpid() % 20
    client = 2**63 + 5
    with closing(Robot(domain)) as robot, peer("dds_peer.py", str(domain)) as talk:
        wait_for(lambda: talk("pauses_are_heard"), "the service")
        talk("pause", client, 7)
        talk("pause", client, 8)
        answers = list[list[object]]()

        def have_come() -> bool:
            answers.extend(talk("answers"))
            return len(answers) > 1

        wait_for(have_come, "the answers")
        handed = [True, "'pause' handed to the robot"]
        assert answers == [[client, 7, *handed], [client, 8, *handed]]
        events, _ = robot.inbox.drain(1.0)
        assert [event.request.word for event in events] == ["pause", "pause"]


@nightly.by_day("test_a_client_knows_the_answer_to_its_request_by_its_marks")
def test_a_client_on_fast_dds_is_named_as_one_that_waits_in_vain(fastdds_peer: str) -> None:
    domain = 100 + os.getpid() % 20
    with closing(Robot(domain)) as robot, program(fastdds_peer, str(domain), "localhost") as talk:
        talk("client")
        wait_for(lambda: robot.said, "the report")
        assert robot.said == [
            "DDS: a client of /agribot/pause is on Fast DDS, which carries requests otherwise, and "
            "gets no answer; set RMW_IMPLEMENTATION=rmw_cyclonedds_cpp there"
        ]


def test_types_are_described_as_ros_describes_them() -> None:
    assert to_dds_name("sensor_msgs/msg/Imu") == "sensor_msgs::msg::dds_::Imu_"
    for topic in OUT:
        described = make_dds_type(topic.ros_type, load_dds_types())
        names = [name for name, _ in load_dds_types().fielddefs[topic.ros_type][1]]
        assert list(described.__annotations__) == names
