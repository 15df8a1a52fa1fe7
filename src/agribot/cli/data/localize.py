"""`agribot localize`: where a robot was, from a log of it, by the filter that drives ours."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from agribot.cli.counting import CountProgress
from agribot.core import extras
from agribot.core.errors import ConfigError

if TYPE_CHECKING:
    from agribot.app.localization.log import LogSensor
    from agribot.app.localization.study import Study, StudyOptions
    from agribot.core.messages import Vec3
    from agribot.record.bag.source import BagTopic
    from agribot.record.localization.camera import CameraStudy
    from agribot.record.localization.result import LocalizationRun

_SENSORS: tuple[LogSensor, ...] = ("odom", "imu", "gnss", "mag")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "logs", type=Path, nargs="+", metavar="LOG",
        help="ROS bag, MCAP, recording of ours, NMEA, UBX, CSV, or a folder of them",
    )  # fmt: skip
    for sensor in _SENSORS:
        parser.add_argument(
            f"--{sensor}", metavar="TOPIC|FILE", help="default: by the type of the topic"
        )
    parser.add_argument(
        "--camera", nargs="?", const="auto", metavar="TOPIC",
        help="look at pictures of the log, too: plants, row line and doubt of up to 30 of them "
        "(without a name: the topic with the most)",
    )  # fmt: skip
    parser.add_argument(
        "--model", metavar="NAME|FILE", help="network for --camera (default: that of a run)"
    )
    _add_robot(parser)
    parser.add_argument(
        "--outage", action="append", default=[], metavar="A-B",
        help="withhold the fixes from A to B, seconds from the first message; repeatable",
    )  # fmt: skip
    parser.add_argument(
        "--set", action="append", default=[], dest="settings", metavar="A.B=C",
        help="a setting of the filter; repeatable",
    )  # fmt: skip
    parser.add_argument(
        "--with", action="append", default=[], dest="changes", metavar="A.B=C",
        help="run a second time with this setting, side by side; repeatable",
    )  # fmt: skip
    parser.add_argument(
        "--stamps", choices=("header", "log"), default="header",
        help="times of the messages' headers, or of the recorder (default: header)",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--gpx", action="store_true", help="write poses.gpx as well")
    parser.add_argument("--json", action="store_true", help="print the result as the last line")


def _add_robot(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robot", metavar="FILE", help="description of the robot of the log")
    parser.add_argument("--track", type=_read_length, metavar="M", help="between left and right")
    parser.add_argument("--radius", type=_read_length, metavar="M", help="of the wheels")
    parser.add_argument(
        "--antenna", metavar="X,Y,Z", help="forward, left and above the ground (default: 0,0,0)"
    )
    parser.add_argument(
        "--imu-rpy-deg", metavar="R,P,Y",
        help="turns the IMU's axes into the body's: fixed axes x, y, z (default: found)",
    )  # fmt: skip
    parser.add_argument("--ticks-per-turn", type=_read_length, metavar="N", help="of encoders")


def _read_length(text: str) -> float:
    with contextlib.suppress(ValueError):
        value = float(text)
        if math.isfinite(value) and value > 0.0:
            return value
    raise argparse.ArgumentTypeError(f"{text}: out of range; give a number above 0")


def run(options: argparse.Namespace) -> int:
    extras.require("report", "agribot localize")
    from agribot.app.localization.log_pictures import find_camera
    from agribot.app.localization.study import make_config, open_study
    from agribot.record.bag.opening import check_target
    from agribot.record.localization.result import OUTPUT_NAMES

    stated = _read_options(options)
    make_config((*options.settings, *options.changes))  # wrong settings are refused before the work
    for path, name in itertools.product(options.logs, OUTPUT_NAMES):
        if path.is_file():
            check_target(path, options.out / name, "result")
    found = None if options.camera is None else find_camera(options.logs, options.camera)
    study = open_study(options.logs, stated, lambda total: _show_progress(total, "messages read"))
    _print_facts(study)
    camera = _study_pictures(found, study, options)
    runs, camera = _localize(study, camera, options)
    _print_result(runs, camera, options)
    return 0 if runs[0].result.started_after_s is not None else 1


def _show_progress(total: int, what: str) -> Callable[[int], None]:
    """Show how much of a log is done; nothing where its files do not say how much it is."""
    if not total:
        return lambda done: None
    progress = CountProgress(total, what)

    def show(done: int) -> None:
        progress(done)
        if done == total:
            progress.close()

    return show


def _read_options(options: argparse.Namespace) -> StudyOptions:
    """Read what is stated. Raises: ConfigError: it cannot be meant."""
    from agribot.app.localization.study import StudyOptions

    if options.robot is not None and (options.track or options.radius):
        raise ConfigError("--robot brings track and radius; leave out --track and --radius")
    return StudyOptions(
        named={name: value for name in _SENSORS if (value := getattr(options, name)) is not None},
        robot=options.robot,
        track_m=options.track,
        radius_m=options.radius,
        antenna_body_m=_read_three("--antenna", options.antenna, "X,Y,Z in metres"),
        imu_rpy_deg=_read_three("--imu-rpy-deg", options.imu_rpy_deg, "R,P,Y in degrees"),
        ticks_per_turn=options.ticks_per_turn,
        outages=tuple(_read_outage(text) for text in options.outage),
        settings=tuple(options.settings),
        uses_log_times=options.stamps == "log",
    )


def _read_three(option: str, text: str | None, what: str) -> Vec3 | None:
    if text is None:
        return None
    with contextlib.suppress(ValueError):
        x, y, z = (float(word) for word in text.split(","))
        if math.isfinite(x + y + z):
            return x, y, z
    raise ConfigError(f"{option} {text}: not three numbers; give {what}, as in {option} 0.1,0,0.5")


def _read_outage(text: str) -> tuple[float, float]:
    with contextlib.suppress(ValueError):
        from_s, to_s = (float(word) for word in text.split("-"))
        if math.isfinite(from_s + to_s) and from_s < to_s:
            return from_s, to_s
    raise ConfigError(f"--outage {text}: not two times in order; write --outage 100-160")


def _print_facts(study: Study) -> None:
    facts = study.facts
    for each in facts.sources:
        sys.stderr.write(
            f"{each.sensor}: {each.source} ({each.kind}), {each.measurements} of {each.messages} "
            f"messages, {each.from_s:.1f} to {each.to_s:.1f} s\n"
        )
    lines = [f"IMU: the body's axes are {facts.mount}", *facts.robot]
    lines += [f"note: {note}" for note in facts.notes]
    sys.stderr.write("".join(f"{line}\n" for line in lines))


def _study_pictures(
    found: tuple[Path, BagTopic] | None, study: Study, options: argparse.Namespace
) -> CameraStudy | None:
    """Look at the pictures of the log, where that is asked for."""
    if found is None:
        return None
    from agribot.app.localization.log_pictures import MOST_PICTURES, study_pictures
    from agribot.autonomy.perceive.segmenter import Segmenter

    network = Segmenter(options.model or study.config.perception.model, threads=2)
    shown = _show_progress(min(found[1].count, MOST_PICTURES), "pictures looked at")
    return study_pictures(
        found, network, study.facts.start_stamp_s, shown, uses_log_times=options.stamps == "log"
    )


def _localize(
    study: Study, camera: CameraStudy | None, options: argparse.Namespace
) -> tuple[list[LocalizationRun], CameraStudy | None]:
    from agribot.app.localization.localize import LocalizedTick
    from agribot.app.localization.log_pictures import PicturePoses
    from agribot.app.localization.study import run_study
    from agribot.record.localization.camera import write_pictures_table
    from agribot.record.localization.page import write_localization_page
    from agribot.record.localization.pose_files import EstimateMcap, PoseFiles

    out, start_s = options.out, study.facts.start_stamp_s
    with (
        PoseFiles(out, study.config.field.datum, start_s, has_gpx=options.gpx) as poses,
        contextlib.closing(EstimateMcap(out / "estimate.mcap", study.robot, start_s)) as mcap,
    ):

        def write(tick: LocalizedTick) -> None:
            mcap.add(tick.batch, tick.estimate)
            if tick.estimate is not None:
                poses.add(tick.estimate)

        total = sum(each.messages for each in study.facts.sources)
        shown = _show_progress(total, "messages through the filter")
        placed = PicturePoses([] if camera is None else [one.t_s for one in camera.pictures])
        runs = run_study(study, options.changes, (write, placed), shown)
        poses.write_gpx(study.facts.name)
    if camera is not None:
        camera = msgspec.structs.replace(camera, poses=placed.poses)
        write_pictures_table(out / "pictures.csv", camera)
    write_localization_page(out / "report.html", runs, study.facts, camera)
    return runs, camera


def _print_result(
    runs: list[LocalizationRun], camera: CameraStudy | None, options: argparse.Namespace
) -> None:
    if options.json:
        line = msgspec.to_builtins(runs[0].result)
        if camera is not None:
            line["camera"] = camera.summarize()
        if len(runs) > 1:
            line["with"] = {"settings": options.changes, **msgspec.to_builtins(runs[1].result)}
        sys.stdout.write(msgspec.json.encode(line).decode() + "\n")
        return
    for one in runs:
        sys.stdout.write(_format_run(one) + "\n")
    if camera is not None:
        sys.stdout.write(_format_camera(camera.summarize()) + "\n")
    sys.stdout.write(f"{options.out}/report.html\n")


def _format_run(one: LocalizationRun) -> str:
    r = one.result
    named = f"with {', '.join(one.settings)}: " if one.settings else ""
    if r.started_after_s is None:
        return f"{named}{r.reason}"
    lines = [
        f"{named}began after {r.started_after_s:.1f} s and {r.started_after_m:.1f} m; "
        f"{r.used} of {r.fixes} fixes used; {_format(r.rms_to_fixes_m)} m RMS to the fixes from "
        f"60 s on; {_format(r.within_3_sigma_ratio)} within 3 sigma; normalised innovation "
        f"{_format(r.nis_mean)} in the mean (2 is honest); {r.reason}"
    ]
    lines += [
        f"outage {each.from_s:g} to {each.to_s:g} s: {_format(each.driven_m)} m driven, "
        f"{_format(each.error_m)} m off, {_format(each.sigma_m)} m stated"
        for each in r.outages
    ]
    return "\n".join(lines)


def _format(value: float | None) -> str:
    return "no" if value is None else f"{value:.2f}"


def _format_camera(summary: dict[str, Any]) -> str:
    return (
        f"camera {summary['topic']}: looked at {summary['pictures']} of {summary['messages']} "
        f"pictures, row line in {summary['rows_found']}, crop on {summary['crop_ratio']:.1%} and "
        f"weed on {summary['weed_ratio']:.1%} of their pixels, {summary['unfit']} unfit"
    )
