"""A user of ROS 2 at this robot: the same steps over rmw_zenoh's wire and over DDS."""

from __future__ import annotations

import itertools
import os
import re
from contextlib import closing
from pathlib import Path

import pytest

from agribot.core.inbound_topics import CLICKED_POINT
from agribot.core.messages.requests import AskerKind, PointOut, Who
from tests.ros.driven_robot import SETTINGS, driven_robot
from tests.ros.live import free_port
from tests.ros.ros2_transports import DdsUser, ZenohUser
from tests.ros.ros2_user import STEPS, User, run_steps
from tests.waiting import wait_for

pytest.importorskip("cyclonedds")
TICK_S = 0.008  # two and a half times as fast as the clock, which its bridges keep up with
SETTINGS_OF_A_USER = (*SETTINGS, "sim.sensors='rtk'")


@pytest.mark.parametrize("network", ["zenoh", "dds"])
def test_every_step_of_a_user_of_ros2_does_to_the_robot_what_it_should(
    network: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    domain, router = 120 + os.getpid() % 20, f"tcp/127.0.0.1:{free_port()}"
    bridge = "--dds" if network == "dds" else "--ros2"
    options = (bridge, "--ros-domain", str(domain), "--ros-router", router, "--allow-drive")
    with (
        driven_robot(tmp_path, *options, pause_s=TICK_S, settings=SETTINGS_OF_A_USER),
        closing(DdsUser(domain) if network == "dds" else ZenohUser(router, domain)) as transport,
    ):
        failed = run_steps(User(transport, tmp_path / "events.jsonl"))
        said = capsys.readouterr().out
        steps = [line.partition("  ")[0] for line in said.splitlines()]
        assert (failed, steps) == (0, ["pass"] * (len(STEPS) + len(transport.steps))), said


def test_a_point_of_the_page_is_published_once_and_not_taken_for_one_of_a_peer(
    tmp_path: Path,
) -> None:
    domain, router = 140 + os.getpid() % 20, f"tcp/127.0.0.1:{free_port()}"
    options = ("--ros2", "--dds", "--ros-domain", str(domain), "--ros-router", router)
    events, places = tmp_path / "events.jsonl", itertools.count()
    with (
        driven_robot(tmp_path, *options, pause_s=TICK_S) as session,
        closing(DdsUser(domain)) as dds,
        closing(ZenohUser(router, domain)) as zenoh,
    ):
        both = (dds, zenoh)
        for user in both:
            user.hear(CLICKED_POINT)

        def is_heard() -> bool:
            """Point out another place: a network that begins to listen has no earlier one."""
            place = PointOut(x_map_m=float(next(places)), y_map_m=4.0)
            session.inbox.post(place, Who("Ada", AskerKind.OPERATOR))
            return all(user.heard[CLICKED_POINT.name] for user in both)

        wait_for(is_heard, "a point in both networks")
        for user in both:
            user.request("mark")  # what the robot made of the points has come with the mark
        wait_for(lambda: events.read_text().count('"mark"') == 2, "the marks")
        for user in both:
            east = [message.point.x for message in user.heard[CLICKED_POINT.name]]
            assert len(set(east)) == len(east)
        pointed_by = set(re.findall(r"point: [^(]*\(([^)]*)\)", events.read_text()))
        assert pointed_by == {"Ada"}
