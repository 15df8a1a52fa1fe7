"""A user of ROS 2 at this robot: the same steps over rmw_zenoh's wire and over DDS."""

from __future__ import annotations

import os
from contextlib import closing
from pathlib import Path

import pytest

from tests.ros.driven_robot import SETTINGS, driven_robot
from tests.ros.live import free_port
from tests.ros.ros2_transports import DdsUser, ZenohUser
from tests.ros.ros2_user import STEPS, User, run_steps

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
