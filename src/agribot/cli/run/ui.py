"""`agribot ui`: the page on a simulated robot, or on a recording."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from agribot.cli.run import run as run_command
from agribot.cli.run.bridging import add_ros1_arguments, add_ros2_arguments
from agribot.cli.run.origin import HELP
from agribot.cli.run.page import add_address_arguments, choose_address, find_ros_places, serve_page

if TYPE_CHECKING:
    from agribot.ui.about import About


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "what", nargs="?", default="farm", help="a profile to simulate, or a run.mcap to replay"
    )
    parser.add_argument("--out", metavar="DIR", help="of a simulated run")
    parser.add_argument("--origin", metavar="ORIGIN", help=HELP)
    parser.add_argument("--set", action="append", default=[], metavar="A.B=C", help="any setting")
    add_address_arguments(parser)
    group = parser.add_argument_group("ROS, whose topics the map can show")
    add_ros1_arguments(group)
    add_ros2_arguments(group)


def run(options: argparse.Namespace) -> int:
    if options.what.endswith(".mcap"):
        return _replay(options, Path(options.what))
    parser = argparse.ArgumentParser()
    run_command.add_arguments(parser)
    simulated = parser.parse_args([options.what, "--ui", "--stay", "--speed", "1"])
    for name in (
        "out",
        "origin",
        "set",
        "port",
        "host",
        "allow_host",
        "tls_cert",
        "tls_key",
        "token_file",
        "open",
        "ros_master",
        "ros_domain",
        "ros_router",
    ):
        setattr(simulated, name, getattr(options, name))
    return run_command.run(simulated)


def _replay(options: argparse.Namespace, recording: Path) -> int:
    from agribot.description.loader import parse_robot
    from agribot.record.replay import read_config, read_urdf
    from agribot.ui.ground import read_field
    from agribot.ui.robot_side.about_run import about_run
    from agribot.ui.robot_side.server_process import ServerProcess

    address = choose_address(options)
    config, urdf = read_config(recording), read_urdf(recording)
    robot = parse_robot(urdf, recording.name)
    field = read_field(recording)
    ros = find_ros_places(options)
    path = str(recording.resolve())

    def about(port: int) -> About:
        shown = about_run(address, port, config, robot, urdf, field, recording.parent, path)
        return msgspec.structs.replace(shown, ros=ros)

    return serve_page(ServerProcess(address, about), "replay", options)
