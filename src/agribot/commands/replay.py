"""`agribot replay`: the stack again on recorded batches; every command must be the same."""

from __future__ import annotations

import argparse
import json
import sys
from itertools import zip_longest
from pathlib import Path

import msgspec

from agribot.description.loader import parse_robot
from agribot.errors import EndOfRecording
from agribot.field_work import field_work
from agribot.messages import RobotCommand
from agribot.perception_host import RecordedPerception
from agribot.plan.saved_mission import SavedMission
from agribot.record.mcap_file import read_attachment
from agribot.record.replay import (
    ReplayPlatform,
    read_config,
    read_ticks,
    read_urdf,
    recorded_scenes,
)
from agribot.session import GOALS_ATTACHMENT, PLAN_ATTACHMENT, SAVED_ATTACHMENT
from agribot.stack import MapPoint, build


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, metavar="RUN.mcap")
    parser.add_argument("--json", action="store_true", help="print the result as the last line")


def run(options: argparse.Namespace) -> int:
    config = read_config(options.recording)
    robot = parse_robot(read_urdf(options.recording), "recorded robot")
    perception = RecordedPerception(recorded_scenes(options.recording))
    goals = read_attachment(options.recording, GOALS_ATTACHMENT)
    goals_map_m = msgspec.json.decode(goals, type=tuple[MapPoint, ...])
    text = read_attachment(options.recording, PLAN_ATTACHMENT).decode() if config.plan else ""
    work = field_work(text, config, robot)
    resumed = read_attachment(options.recording, SAVED_ATTACHMENT)
    saved = msgspec.json.decode(resumed, type=SavedMission | None)
    stack = build(config, robot, goals_map_m, perception, work, saved)
    platform = ReplayPlatform(options.recording)
    try:
        while True:
            stack.tick(platform)
    except EndOfRecording:
        pass
    finally:
        platform.close()
    recorded = [tick.command for tick in read_ticks(options.recording)]
    first = _first_difference(recorded, platform.commands)
    result = {"ticks": len(recorded), "identical": first is None, "first_difference": first}
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    elif first is None:
        sys.stdout.write(f"{len(recorded)} ticks replayed: every command is identical\n")
    else:
        sys.stdout.write(f"commands differ from tick {first} of {len(recorded)} on\n")
    return 0 if first is None else 1


def _first_difference(recorded: list[RobotCommand], replayed: list[RobotCommand]) -> int | None:
    for index, (before, now) in enumerate(zip_longest(recorded, replayed)):
        if before != now:
            return index
    return None
