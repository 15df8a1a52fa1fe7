"""`agribot describe`: check, convert and show the robot description."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

import msgspec

from agribot.cli.fields.world import print_findings
from agribot.cli.run.page import add_address_arguments, choose_address, serve_page

if TYPE_CHECKING:
    from agribot.description.fixture import FixtureSpec


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--robot",
        default="agribot",
        metavar="NAME|FILE",
        help="xacro, URDF or SDF; arguments of a xacro follow it: 'x.xacro wheels:=4'",
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--urdf", action="store_true", help="print the expanded URDF")
    what.add_argument("--sdf", action="store_true", help="print it as an SDF model for gz-sim")
    what.add_argument("--tree", action="store_true", help="print links and joints as a tree")
    what.add_argument(
        "--check",
        action="store_true",
        help="list every fault and every note as FILE:LINE, and fail on faults",
    )
    what.add_argument(
        "--ui", action="store_true", help="show it in 3D with a slider for each joint, until Ctrl-C"
    )
    add_address_arguments(parser.add_argument_group("page, with --ui"))
    parser.add_argument("--json", action="store_true", help="print what was understood as JSON")


def _show(options: argparse.Namespace) -> int:
    from agribot.ui.robot_side.about_run import about_robot
    from agribot.ui.robot_side.server_process import ServerProcess

    address = choose_address(options)
    server = ServerProcess(address, lambda port: about_robot(address, port, options.robot))
    return serve_page(server, options.robot, options)


def _describe_fixture(fixture: FixtureSpec, options: argparse.Namespace) -> int:
    from agribot.description.export import format_tree
    from agribot.description.fixture import refuse_form
    from agribot.description.loader import export_urdf

    sys.stderr.writelines(f"warning: {warning}\n" for warning in fixture.warnings)
    for form in ("ui", "sdf"):
        if getattr(options, form):
            raise refuse_form(fixture, f"--{form}")
    if options.urdf:
        sys.stdout.write(export_urdf(options.robot))
    elif options.tree:
        sys.stdout.write(format_tree(fixture) + "\n")
    elif not options.json:
        sys.stdout.write(fixture.describe())
    if options.json:
        sys.stdout.write(msgspec.json.encode(fixture).decode() + "\n")
    return 0


def run(options: argparse.Namespace) -> int:
    from agribot.description.export import format_tree
    from agribot.description.loader import check_robot, export_urdf, load_fixture, load_robot
    from agribot.description.robot_sdf import export_sdf

    if options.check:
        return print_findings(check_robot(options.robot), options.json)
    fixture = load_fixture(options.robot)
    if fixture is not None:
        return _describe_fixture(fixture, options)
    robot = load_robot(options.robot)
    sys.stderr.writelines(f"warning: {warning}\n" for warning in robot.warnings)
    if options.ui:
        return _show(options)
    if options.urdf:
        sys.stdout.write(export_urdf(options.robot))
    elif options.sdf:
        sys.stdout.write(export_sdf(robot))
    elif options.tree:
        sys.stdout.write(format_tree(robot) + "\n")
    elif not options.json:
        drive = robot.drive
        sys.stdout.write(
            f"{robot.name}: {len(robot.links)} links, {len(robot.joints)} joints, "
            f"{robot.mass_kg:.3f} kg\n"
            f"wheel radius {drive.wheel_radius_m} m, track {drive.track_m} m, "
            f"wheelbase {drive.wheelbase_m} m, "
            f"effective separation {drive.effective_separation_m:.3f} m\n"
            "it can be driven\n"
        )
    if options.json:
        sys.stdout.write(msgspec.json.encode(robot).decode() + "\n")
    return 0
