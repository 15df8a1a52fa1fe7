"""`agribot record`: look after recordings of runs; `agribot run` itself makes them."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import msgspec

from agribot.record.bag.info import in_words, read_info
from agribot.record.recovery import Recovery, recover


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    saving = actions.add_parser(
        "recover",
        help="make a whole file of a recording that was cut off or has no index",
        description="Make a whole file of a recording that was cut off or has no index.",
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
    for action in (saving, looking):
        action.add_argument("--json", action="store_true", help="the result as the last line")


def run(options: argparse.Namespace) -> int:
    if options.action == "info":
        info = read_info(options.recording)
        text = msgspec.json.encode(info).decode() + "\n" if options.json else in_words(info)
        sys.stdout.write(text)
        return 0
    source: Path = options.recording
    saved = recover(source, options.out or source.with_name(f"{source.stem}-recovered.mcap"))
    sys.stdout.write(msgspec.json.encode(saved).decode() + "\n" if options.json else _words(saved))
    return 0


def _words(saved: Recovery) -> str:
    lost = "" if saved.was_whole else f"; {saved.lost_bytes} bytes at the end were damaged"
    return (
        f"{saved.path}: {saved.messages} messages on {saved.topics} topics, "
        f"{saved.duration_s:.2f} s, {saved.files} files inside{lost}\n"
    )
