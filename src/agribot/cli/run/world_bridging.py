"""Bridges of a simulated world: sensors out and drive commands in, as Gazebo's plugins did."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from agribot.cli.run.bridging import (
    is_wanted,
    list_out_topics,
    open_gateways,
    open_noise,
    print_line,
    report_losses,
)
from agribot.core import topics
from agribot.core.config import RunConfig
from agribot.core.messages import STOP, DriveCommand, HandDrive
from agribot.core.robot import RobotSpec
from agribot.ros.requests import Requests

if TYPE_CHECKING:
    from agribot.ros.messages.world_topic_writer import WorldTick
    from agribot.sim.platform import SimPlatform

    WorldTap = Callable[[WorldTick], None]

# Topics out of the world. A compass gives a field; a node that turns it into a heading is not part
# of the world.
_OUT = {
    topic.name
    for topic in (
        topics.FIX, topics.FIX_VELOCITY, topics.IMU, topics.IMU_BIAS, topics.MAGNETIC,
        topics.POLE_FIX, topics.POLE_FIX_VELOCITY, topics.CALIBRATED, topics.SCAN, topics.BUMPER,
        topics.BATTERY, topics.JOINT_STATES, topics.ODOM, topics.CMD_VEL, topics.IMAGE,
        topics.IMAGE_RAW, topics.CAMERA_INFO, topics.TF, topics.TF_STATIC,
        topics.ROBOT_DESCRIPTION, topics.CLOCK, topics.GROUND_TRUTH,
    )
}  # fmt: skip


def take_twist(hand: Sequence[HandDrive]) -> DriveCommand | None:
    """Take the newest request of a peer; one that is not finite stops. None without a request."""
    if not hand:
        return None
    newest = hand[-1]
    if not (math.isfinite(newest.v_mps) and math.isfinite(newest.yaw_rate_radps)):
        return STOP
    return DriveCommand(v_mps=newest.v_mps, yaw_rate_radps=newest.yaw_rate_radps)


@contextmanager
def open_world_bridges(
    options: argparse.Namespace,
    platform: SimPlatform,
    robot: RobotSpec,
    config: RunConfig,
    is_free: bool,
) -> Iterator[list[WorldTap]]:
    """Open what the options name; peers may drive where the command line `is_free` of a driver.

    Raises: AgribotError: an option is out of range, or a peer that must be there is not.
    """
    from agribot.description.loader import export_urdf
    from agribot.ros.messages.camera_log import CameraLog
    from agribot.ros.world_publisher import WorldPublisher

    if not is_wanted(options):
        yield []
        return
    requests = Requests(platform.inbox, allow_drive=is_free, report=print_line)
    has_camera = robot.camera is not None and config.perception.enabled
    out = [
        topic
        for topic in list_out_topics(options, has_camera=has_camera, allow_drive=is_free)
        if topic.name in _OUT
    ]
    urdf = export_urdf(config.robot)
    gateways = open_gateways(options, out, urdf, requests, None)
    gateways += open_noise(options, platform, is_open=True)
    camera = CameraLog(
        robot, options.image_rate, config.record.jpeg_quality, keeps_raw=options.raw_images
    )
    outlet = WorldPublisher(
        gateways, robot, urdf, camera, config.estimate, has_map=options.perfect_map
    )
    try:
        yield [outlet]
    finally:
        outlet.close()
        report_losses(outlet.dropped, outlet.fault)
