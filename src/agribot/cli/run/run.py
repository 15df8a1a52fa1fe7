"""`agribot run`: the robot through a mission, with progress, recording and an honest report."""

from __future__ import annotations

import argparse
import signal
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from agribot.app import service_manager
from agribot.app.run_folder import check_free, check_not_driven
from agribot.app.stop_memory import StopMemory
from agribot.app.unattended import INTERRUPTED
from agribot.cli.ranges import finite
from agribot.cli.run import bridging, sensor_sources
from agribot.cli.run.pacing import parse_pace
from agribot.cli.run.page import (
    Pacer,
    add_page_arguments,
    choose_address,
    has_page,
    is_kept_open,
    keep_ready,
    open_page,
)
from agribot.cli.run.progress import RunProgress, explain_wait
from agribot.cli.run.run_settings import add_setting_arguments, choose_out_dir, read_settings
from agribot.cli.run.run_summary import format_summary
from agribot.cli.standard_error import write_words
from agribot.cli.stopping import stop_on_signal
from agribot.core import extras
from agribot.core.config import RunConfig
from agribot.core.errors import ConfigError, MissionError
from agribot.core.fact_text import render
from agribot.core.facts import (
    CutOffStanding,
    Disarmed,
    DisarmedAlone,
    FieldUnfit,
    NothingToClear,
    OptionOutside,
    Said,
    SentAway,
    StillStopped,
)
from agribot.core.platforms import PlatformKind, find_platform, require_platform
from agribot.drivers.line.schemes import read_sources

if TYPE_CHECKING:
    from agribot.app.run import Run
    from agribot.autonomy.plan.mission.saved_mission import SavedMission

STARTING = (
    "starting the simulator; the first start on a machine compiles it, which takes about half a "
    "minute"
)
OPENING = "opening the robot's devices"


FIELD_HELP = (
    "plan this field and work it: every format of agribot plan --field; of several fields and A-B "
    "lines in it those of FILE#NAME"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_setting_arguments(parser)
    parser.add_argument(
        "--platform",
        metavar="NAME",
        help="what drives: sim (default), firmware (the simulator with the board's real firmware), "
        "hardware with --source base=..., or module:function of your own",
    )
    parser.add_argument(
        "--arm",
        action="store_true",
        help="on hardware: the motors may turn from the start; else a person clears a first stop",
    )
    parser.add_argument(
        "--waypoints", metavar="FILE", help="visit these places (GeoJSON, or CSV with lat and lon)"
    )
    parser.add_argument("--task", choices=("rows", "explore"),
                        help="drive the rows of the field (default), or find them by camera and "
                             "draw them as field.geojson")  # fmt: skip
    parser.add_argument("--plan", metavar="FILE", help="work a field plan (agribot plan --out)")
    _add_field_arguments(parser)
    parser.add_argument("--resume", metavar="RUNDIR", help="go on with a run that was cut off")
    parser.add_argument(
        "--clear-stop",
        action="store_true",
        help="with --resume: clear the stop or pause in which that run ended; on hardware: the "
        "stop that is not yet cleared",
    )
    parser.add_argument(
        "--speed",
        metavar="max|K",
        help="simulate as fast as possible (default), or K x real time (1 with a bridge)",
    )
    parser.add_argument(
        "--out", metavar="DIR", help="a new folder (default: runs/<UTC time>-<profile>)"
    )
    parser.add_argument("--json", action="store_true", help="print the report as the last line")
    parser.add_argument(
        "--headless", action="store_true", help="no page, whatever else is asked for"
    )
    add_page_arguments(parser)
    sensor_sources.add_arguments(parser)
    bridging.add_arguments(parser)


def _add_field_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--field", metavar="FILE", help=FIELD_HELP)
    parser.add_argument("--keep-out", metavar="MAP.yaml",
                        help="a map of map_server: no part of the robot enters its occupied "
                             "cells")  # fmt: skip
    parser.add_argument("--implement-width", type=finite, metavar="M",
                        help="for --field (default: that of the robot)")  # fmt: skip
    parser.add_argument("--margin", type=finite, metavar="M",
                        help="for --field: from the robot to every edge (default: as the file "
                             "says, else 0.05); 4 for a receiver without corrections")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    config = _read_config(options)
    has_sources = bool(read_sources(config.sources))
    kind = require_platform(config.platform)
    # A run that is no simulation goes by its own clock.
    is_live = (bridging.is_wanted(options) or has_sources) and kind.is_simulated
    _check(options, config)
    pace = parse_pace(options.speed or ("1" if is_live else "max"))
    with (
        _open_run(options, config, kind) as session,
        stop_on_signal() as stop,  # before a page states its address
        ExitStack() as parts,
    ):
        sys.stderr.writelines(f"{note}\n" for note in session.notes)
        sys.stderr.writelines(f"warning: {warning}\n" for warning in session.warnings)
        service = parts.enter_context(service_manager.open_service(session))
        page = parts.enter_context(open_page(options, session)) if has_page(options) else None
        session.unattended.is_attended = _has_operator(options)
        progress = RunProgress(session.weed_map)
        session.add_tap(progress)
        session.trouble_taps.append(progress.note)
        pacer = Pacer(pace, page, keeps_up=has_sources)
        sources = sensor_sources.open_sensor_sources(options, session)
        with sources, bridging.open_bridges(options, session):
            for record in session.ticks():
                if stop:
                    break
                pacer.wait(record.batch.t_s)
            progress.close()
            with service.allow_quiet():
                why_ended = INTERRUPTED if stop else ""
                report = session.finish(why_ended, lambda: signal.SIGTERM not in stop)
            write_words(sys.stderr, format_summary(report, session.out_dir))
            was_interrupted = bool(stop)
            if page is not None and is_kept_open(options) and not stop:
                keep_ready(session, page, stop, keeps_up=has_sources)
    if options.json:
        sys.stdout.write(msgspec.json.encode(report).decode() + "\n")
    if was_interrupted:
        return 130
    return 0 if report.ok and session.is_written else 1


def _open_run(options: argparse.Namespace, config: RunConfig, kind: PlatformKind) -> Run:
    """Open the run that the options name, new or going on.

    Raises: AgribotError: it cannot drive, and why.
    """
    from agribot.app.mission_file import continue_config
    from agribot.app.open_run import open_run
    from agribot.app.whole_job import NOTHING, read_job

    saved, earlier = None, NOTHING
    if options.resume is not None:
        check_not_driven(Path(options.resume))
        saved = _read_cut_off(options)
        earlier = read_job(Path(options.resume), saved)
        config = continue_config(config, saved)
    elif options.clear_stop and not kind.needs_arming:
        raise MissionError(NothingToClear())
    out_dir = choose_out_dir(options.out, Path(config.profile).stem)
    check_free(out_dir)
    if kind.needs_arming:
        _check_arming(options, config, out_dir)
    plan_text = "" if options.field is None else _plan_field(config, options)
    with explain_wait(STARTING if kind.is_simulated else OPENING):
        return open_run(
            config, out_dir, saved, earlier, plan_text,
            is_armed=options.arm, is_cleared=options.clear_stop,
        )  # fmt: skip


def _has_operator(options: argparse.Namespace) -> bool:
    """Return whether an operator can clear a stop and resume: on the page, or over a bridge."""
    return has_page(options) or (bridging.is_wanted(options) and options.allow_drive)


def _read_cut_off(options: argparse.Namespace) -> SavedMission:
    """Read the saved mission that is to go on, without its stop if it is cleared.

    Raises: MissionError: none is there, or it waits for a person who has no way to answer.
    """
    from agribot.app.mission_file import read_mission

    saved = read_mission(Path(options.resume))
    if options.clear_stop or (options.arm and isinstance(saved.stop, Disarmed)):
        saved = saved.release()
    held = saved.stop or saved.pause
    if _has_operator(options) or not (held or saved.asks_first):
        if held:
            clear = "clear the stop and resume it" if saved.stop else "resume it"
            sys.stderr.write(f"the robot stands: {render(held)}; {clear}\n")
        return saved
    raise MissionError(CutOffStanding(options.resume, held or SentAway(), saved.asks_first))


def _check(options: argparse.Namespace, config: RunConfig) -> None:
    """Refuse early what would otherwise be missed only after a long start.

    Raises: ConfigError: what would otherwise be missed only after a long start.
    """
    if config.sources.base and find_platform(config.platform).is_simulated:
        raise ConfigError(
            "--source base= is the motor board of a real robot; add --platform hardware, or leave "
            "it out"
        )
    if has_page(options):
        extras.require("ui", "the operator's page")
        choose_address(options).check_tls()
    bridging.check_bridges(options, read_sources(config.sources))


def _check_arming(options: argparse.Namespace, config: RunConfig, out_dir: Path) -> None:
    """Refuse a machine that begins stopped where no operator could clear the stop.

    Raises: AgribotError: it does, and no operator can.
    """
    if _has_operator(options):
        return
    remembered = StopMemory(config.platform, out_dir).read()
    if remembered is not None and not options.clear_stop:
        cause = remembered.fact or Said(remembered.stopped)
        raise MissionError(StillStopped(config.platform, remembered.since, cause))
    if not options.arm:
        raise MissionError(DisarmedAlone(config.platform))


def _plan_field(config: RunConfig, options: argparse.Namespace) -> str:
    """Plan the field of the options and return the plan's text.

    Raises: MissionError: no field, or one that cannot be worked, and why.
    """
    from agribot.app.field_work import plan_field_file
    from agribot.autonomy.plan.coverage.area import MOST_MARGIN_M
    from agribot.description.loader import load_robot
    from agribot.gis.plan_file import format_plan

    robot = load_robot(config.robot)
    margin_m: float | None = options.margin
    if margin_m is not None and not 0.0 <= margin_m <= MOST_MARGIN_M:
        raise MissionError(OptionOutside("--margin", margin_m, 0.0, MOST_MARGIN_M))
    saved, certificate = plan_field_file(
        Path(options.field), config, robot, options.implement_width, margin_m
    )
    if not certificate.ok:
        problem = certificate.problems[0]
        raise MissionError(FieldUnfit(options.field, problem.rule, problem.fact))
    if saved.area.left_out:
        sys.stderr.write(f"warning: {saved.area.left_out}\n")
    return format_plan(saved, certificate)


def _read_config(options: argparse.Namespace) -> RunConfig:
    resumed_profile = None if options.resume is None else str(Path(options.resume) / "config.toml")
    return read_settings(
        options, resumed_profile, after=sensor_sources.read_source_settings(options)
    )
