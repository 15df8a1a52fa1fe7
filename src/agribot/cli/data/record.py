"""`agribot record`: repair recordings; begin, end and mark those of a running robot."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from agribot.cli.output_names import check_ending
from agribot.cli.robot_address import add_robot_arguments, find_robot
from agribot.core.errors import PlatformError
from agribot.ui import wire
from agribot.ui.hand.remote import Remote

if TYPE_CHECKING:
    from agribot.record.recovery import Recovery

ORDERS = {"start": "begin a recording", "stop": "end the recording", "mark": "mark the moment"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    saving = actions.add_parser(
        "recover",
        help="make a whole file of a recording that was cut off, is damaged or has no index",
        description="Make a whole file of a recording that was cut off, is damaged or has no "
        "index; exit status 1 where messages or files of its middle are missing.",
        epilog="example: agribot record recover runs/first/run.mcap",
    )
    saving.add_argument("recording", type=Path, metavar="FILE.mcap")
    saving.add_argument(
        "-o", "--out", type=Path, metavar="FILE", help="default: FILE-recovered.mcap"
    )
    looking = actions.add_parser(
        "info",
        help="what a recording holds, as agribot bag info",
        description="What a recording holds, as agribot bag info.",
        epilog="example: agribot record info runs/first/run.mcap",
    )
    looking.add_argument("recording", type=Path, metavar="FILE")
    orders = [_add_order(actions, name) for name in ORDERS]
    orders[-1].add_argument("text", help="what happened")
    for action in (saving, looking, *orders):
        action.add_argument("--json", action="store_true", help="the result as the last line")


def _add_order(actions: Any, name: str) -> argparse.ArgumentParser:
    about = f"{ORDERS[name]} of a robot that runs with a page"
    text = ' "a stone"' if name == "mark" else ""
    order: argparse.ArgumentParser = actions.add_parser(
        name, help=about, description=f"{about[0].upper()}{about[1:]}.",
        epilog=f"example: agribot record {name}{text} --port 8080",
    )  # fmt: skip
    add_robot_arguments(order)
    return order


def run(options: argparse.Namespace) -> int:
    from agribot.record.bag.info import format_info, read_info
    from agribot.record.recovery import recover

    if options.action in ORDERS:
        return _send_to_robot(options)
    if options.action == "info":
        info = read_info(options.recording)
        text = msgspec.json.encode(info).decode() + "\n" if options.json else format_info(info)
        sys.stdout.write(text)
        return 1 if info.has_gaps else 0
    source: Path = options.recording
    target = options.out or source.with_name(f"{source.stem}-recovered.mcap")
    check_ending("-o", target, "an MCAP recording", ".mcap")
    saved = recover(source, target)
    sys.stdout.write(
        msgspec.json.encode(saved).decode() + "\n" if options.json else _format_recovery(saved)
    )
    if not saved.messages:
        sys.stderr.write(f"{source}: no message of it was sound: no drive was recovered\n")
    return 0 if saved.messages and not saved.has_gaps else 1


def _send_to_robot(options: argparse.Namespace) -> int:
    """Send to the robot and wait for its answer; 1 where none comes."""
    is_mark, is_start = options.action == "mark", options.action == "start"
    with Remote(find_robot(options), "agribot record") as robot:
        refusal = robot.ask(
            wire.MarkMoment(text=options.text)
            if is_mark
            else wire.ControlRecording(action=options.action)
        )
        if refusal:
            raise PlatformError(refusal)
        state = robot.until(lambda now: is_mark or bool(now.recording) == is_start)
    name = state.recording or None
    text = "marked" if is_mark else f"recording {name}" if name else "no recording any more"
    result = json.dumps({"ok": True, "recording": name})
    sys.stdout.write(f"{result if options.json else text}\n")
    return 0


def _format_recovery(saved: Recovery) -> str:
    lines = [
        f"{saved.path}: {saved.messages} messages on {saved.topics} topics, "
        f"{saved.duration_s:.2f} s, {saved.files} files inside",
        *(f"note: {damage}" for damage in saved.damage),
    ]
    return "\n".join(lines) + "\n"
