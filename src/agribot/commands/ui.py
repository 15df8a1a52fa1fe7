"""`agribot ui`: the page on a simulated robot, or on a recording."""

from __future__ import annotations

import argparse
from pathlib import Path

import msgspec

from agribot.commands import run as run_command
from agribot.commands.origin import HELP
from agribot.commands.page import add_address_arguments, address_of, show
from agribot.description.loader import parse_robot
from agribot.field_work import field_work
from agribot.record.mcap_file import read_attachment
from agribot.record.replay import read_config, read_urdf
from agribot.session import GOALS_ATTACHMENT, PLAN_ATTACHMENT
from agribot.tasks import MapPoint, task_of
from agribot.ui.about import about_run, field_of
from agribot.ui.hub import About
from agribot.ui.server_process import ServerProcess


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "what", nargs="?", default="farm", help="a profile to simulate, or a run.mcap to replay"
    )
    parser.add_argument("--out", metavar="DIR", help="of a simulated run")
    parser.add_argument("--origin", metavar="ORIGIN", help=HELP)
    parser.add_argument("--set", action="append", default=[], metavar="A.B=C", help="any setting")
    add_address_arguments(parser)


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
        "open",
    ):
        setattr(simulated, name, getattr(options, name))
    return run_command.run(simulated)


def _replay(options: argparse.Namespace, recording: Path) -> int:
    address = address_of(options)
    config, urdf = read_config(recording), read_urdf(recording)
    robot = parse_robot(urdf, recording.name)
    attached = read_attachment(recording, GOALS_ATTACHMENT)
    goals = msgspec.json.decode(attached, type=tuple[MapPoint, ...])
    plan = read_attachment(recording, PLAN_ATTACHMENT).decode() if config.plan else ""
    work = field_work(plan, config, robot)
    task = task_of(config, robot, goals, work)
    field = field_of(config, task.rows, goals, work.area if work else None)
    path = str(recording.resolve())

    def about(port: int) -> About:
        return about_run(address, port, config, robot, urdf, field, recording.parent, path)

    return show(ServerProcess(address, about), "replay", options)
