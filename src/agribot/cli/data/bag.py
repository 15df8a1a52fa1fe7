"""`agribot bag`: show, convert and export recordings of agribot and of others."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from agribot.cli.counting import CountProgress
from agribot.cli.output_names import check_ending
from agribot.core.errors import RecordingError
from agribot.record.report import write_file

if TYPE_CHECKING:
    from agribot.record.bag.convert import ConvertResult

_EXAMPLES = {
    "info": "agribot bag info field.bag",
    "convert": "agribot bag convert runs/first/run.mcap first.bag",
    "track": "agribot bag track runs/first/run.mcap -o first.gpx",
    "csv": "agribot bag csv field.bag /fix -o fix.csv",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    made = {}
    for name, about in (
        ("info", "topics, types, rates, times and damage of a recording"),
        ("convert", "a recording as .bag, .db3, .mcap or a rosbag2 folder"),
        ("track", "where the robot was, as .gpx, .kml or .csv"),
        ("csv", "all messages of one topic as a table"),
    ):
        made[name] = actions.add_parser(
            name, help=about, description=f"{about[0].upper()}{about[1:]}.",
            epilog=f"example: {_EXAMPLES[name]}",
        )  # fmt: skip
        made[name].add_argument("recording", type=Path, metavar="FILE")
        made[name].add_argument("--json", action="store_true", help="the result as the last line")
    _add_convert(made["convert"])
    for name in ("track", "csv"):
        made[name].add_argument("-o", "--out", type=Path, required=True, metavar="FILE")
    made["track"].add_argument("--topic", default="", help="default: the robot's GNSS fixes")
    made["csv"].add_argument("topic")


def _add_convert(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("out", type=Path, metavar="OUT", help="the suffix chooses the format")
    parser.add_argument("--topic", action="append", default=[], help="only this one; repeatable")
    fixes = parser.add_mutually_exclusive_group()
    fixes.add_argument("--gpsfix", action="store_true", help="NavSatFix becomes GPSFix")
    fixes.add_argument("--navsatfix", action="store_true", help="GPSFix becomes NavSatFix")
    parser.add_argument(
        "--utm", action="append", default=[], metavar="TOPIC",
        help="add TOPIC/utm: its fixes as odometry on the UTM grid",
    )  # fmt: skip
    parser.add_argument(
        "--from-utm", action="append", default=[], metavar="TOPIC",
        help="add TOPIC/fix: odometry on the UTM grid as fixes",
    )  # fmt: skip
    parser.add_argument("--zone", metavar="43N", help="UTM zone and hemisphere")
    parser.add_argument("--compress", choices=("none", "lz4", "bz2"), default="none", help=".bag")
    parser.add_argument(
        "--storage", choices=("sqlite3", "mcap"), default="sqlite3", help="of a rosbag2 folder"
    )


def run(options: argparse.Namespace) -> int:
    actions = {"info": _show_info, "convert": _convert, "track": _export_track, "csv": _export_csv}
    return actions[options.action](options)


def _show_info(options: argparse.Namespace) -> int:
    from agribot.record.bag.info import format_info, read_info

    info = read_info(options.recording)
    if options.json:
        sys.stdout.write(msgspec.json.encode(info).decode() + "\n")
    else:
        sys.stdout.write(format_info(info))
    return 1 if info.has_gaps else 0


def _convert(options: argparse.Namespace) -> int:
    from agribot.record.bag.convert import ConvertOptions, convert
    from agribot.ros.messages.utm import parse_zone

    fixes_as = "gpsfix" if options.gpsfix else "navsatfix" if options.navsatfix else ""
    wanted = ConvertOptions(
        topics=tuple(options.topic),
        fixes_as=fixes_as,
        utm_of=tuple(options.utm),
        fix_of=tuple(options.from_utm),
        zone=parse_zone(options.zone) if options.zone else None,
        compression=options.compress,
        storage=options.storage,
    )
    progress: list[CountProgress] = []

    def count(done: int, total: int) -> None:
        if done % 5000 == 0:
            if not progress:
                progress.append(CountProgress(max(total, done), "messages"))
            progress[0](done)

    result = convert(options.recording, options.out, wanted, count)
    for shown in progress:
        shown(result.messages_in)
        shown.close()
    for note in (*result.notes, *_format_losses(result)):
        sys.stderr.write(f"note: {note}\n")
    if options.json:
        summary = {"out": str(options.out), **msgspec.to_builtins(result)}
        sys.stdout.write(msgspec.json.encode(summary).decode() + "\n")
    else:
        sys.stdout.write(
            f"{options.out}: {result.messages_out} messages on {len(result.topics)} topics\n"
        )
    return 1 if result.skipped else 0


def _format_losses(result: ConvertResult) -> list[str]:
    return [
        f"{count} messages of {topic} left out: {result.reasons[topic]}"
        for topic, count in result.skipped.items()
    ]


def _export_track(options: argparse.Namespace) -> int:
    from agribot.record.bag.opening import check_target
    from agribot.record.bag.track import SUFFIXES, encode_track, read_track

    if options.out.suffix not in SUFFIXES:
        raise RecordingError(f"{options.out} is no track file; end it in {', '.join(SUFFIXES)}")
    check_target(options.recording, options.out, "track")
    track = read_track(options.recording, options.topic)
    write_file(options.out, encode_track(track, options.out.suffix, options.recording.stem))
    result = {
        "out": str(options.out),
        "topic": track.topic,
        "points": len(track.points),
        "without_fix": track.without_fix,
    }
    if options.json:
        sys.stdout.write(msgspec.json.encode(result).decode() + "\n")
    else:
        lost = f", {track.without_fix} messages without a fix" if track.without_fix else ""
        sys.stdout.write(f"{options.out}: {len(track.points)} points of {track.topic}{lost}\n")
    return 0 if track.points else 1


def _export_csv(options: argparse.Namespace) -> int:
    from agribot.record.bag.table import write_table

    check_ending("-o", options.out, "a table in CSV", ".csv", ".txt")
    rows = write_table(options.recording, options.topic, options.out)
    if options.json:
        result = {"out": str(options.out), "topic": options.topic, "rows": rows}
        sys.stdout.write(msgspec.json.encode(result).decode() + "\n")
    else:
        sys.stdout.write(f"{options.out}: {rows} rows of {options.topic}\n")
    return 0
