"""`agribot report`: write the files of a run again, from its recording alone.

Of another robot's bag, or of a run that was cut off, it plots what is there.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from agribot.app.field_work import read_work
from agribot.app.tasks import TakenPlans
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core import extras
from agribot.core.config import RunConfig
from agribot.core.errors import AgribotError, RecordingError
from agribot.core.messages import Row
from agribot.core.platforms import find_platform
from agribot.record.events import Event, EventLog
from agribot.record.report import Report
from agribot.record.series import RunData, SeriesTap

if TYPE_CHECKING:
    from agribot.autonomy.implements.zones import ZoneMap
    from agribot.record.bag.source import Bag
    from agribot.record.foreign_page import Localized


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, metavar="RUN.mcap", help="or any bag")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--json", action="store_true", help="print the report as the last line")


def run(options: argparse.Namespace) -> int:
    extras.require("report", "agribot report")
    from agribot.record.bag.opening import open_bag
    from agribot.record.mcap_file import read_attachment
    from agribot.record.recorder import CONFIG_ATTACHMENT
    from agribot.record.run_files import write_run_files

    with open_bag(options.recording) as bag:
        is_whole_run = {CONFIG_ATTACHMENT, "report.json"} <= _list_file_names(bag)
    if not is_whole_run:
        return _report_foreign(options)
    data = read_attachment(options.recording, "report.json")
    try:
        report = msgspec.json.decode(data, type=Report)
    except msgspec.MsgspecError as error:
        raise RecordingError(
            f"the report inside {options.recording} is broken: {error}; run agribot record recover"
        ) from error
    write_run_files(options.out, report, _read_job(options.recording, options.out, report))
    if options.json:
        sys.stdout.write(msgspec.json.encode(report).decode() + "\n")
    else:
        sys.stdout.write(f"{options.out}/report.html\n")
    return 0


def _read_job(recording: Path, out: Path, report: Report) -> RunData:
    """Read the recorded run, and from beside it the earlier runs of the same job."""
    from agribot.app.run_recording import PLAN_ATTACHMENT
    from agribot.app.run_world import make_run_world
    from agribot.app.whole_job import events_later, events_of, plants_later, series_of
    from agribot.record.mcap_file import read_attachment_unless_damaged
    from agribot.record.replay import (
        read_config,
        read_gaps,
        read_ticks,
        read_truth,
        read_weed_map_unless_damaged,
    )

    config = read_config(recording)
    series, events = SeriesTap(), EventLog(out / "events.jsonl")
    plans = TakenPlans()
    taken = read_attachment_unless_damaged(recording, PLAN_ATTACHMENT) if config.plan else None
    plan = (taken or b"").decode()
    for record in read_ticks(recording):
        series(record)
        events(record)
        plan = plans.find(record) or plan
    for t_s, x_m, y_m, yaw_rad in read_truth(recording):
        series.truth(t_s, (x_m, y_m, yaw_rad))
    for gap in read_gaps(recording):
        events.add(gap)
    events.close()
    earlier = report.job.runs[:-1] if report.job else ()
    beside = recording.resolve().parent
    joint, lost = series_of(earlier, series.series(), beside)
    earlier_events, lost_events = events_of(earlier, beside)
    for what in (*lost, *lost_events):
        sys.stderr.write(f"of the job's earlier runs is lost: {what}\n")
    began_s = sum(run.run_s for run in earlier)
    return RunData(
        config=config,
        series=joint,
        rows=_read_rows(plan, config, recording),
        plants=plants_later(read_weed_map_unless_damaged(recording), began_s),
        events=(*earlier_events, *events_later(_sort_by_time(events.events), began_s)),
        world=make_run_world(config).world if find_platform(config.platform).is_simulated else None,
        zones=_read_zones(recording, config),
    )


def _sort_by_time(events: Iterable[Event]) -> list[Event]:
    return sorted(events, key=lambda event: event.t_s)


def _read_zones(recording: Path, config: RunConfig) -> ZoneMap | None:
    from agribot.app.prescribed_zones import read_zones
    from agribot.app.run_recording import PRESCRIPTION_ATTACHMENT
    from agribot.record.mcap_file import read_attachment_unless_damaged

    if not config.treatment.prescription:
        return None
    data = read_attachment_unless_damaged(recording, PRESCRIPTION_ATTACHMENT)
    return None if data is None else read_zones(data, config, None)


def _read_rows(plan: str, config: RunConfig, recording: Path) -> tuple[Row, ...]:
    """Read the rows of the task that the robot had at the end."""
    from agribot.description.loader import parse_robot
    from agribot.record.replay import read_urdf

    if plan:
        robot = parse_robot(read_urdf(recording), recording.name)
        return read_work(plan, "the recorded plan", config, robot).rows
    is_by_rows = not (config.waypoints or config.plan) and config.task == "rows"
    return () if not is_by_rows else lay_rows(config.field)


def _list_file_names(bag: Bag) -> set[str]:
    """List the files of all parts of a long recording: the report is in the last one."""
    from agribot.record.bag.opening import open_bag
    from agribot.record.mcap_records import list_parts

    names = set(bag.file_names)
    if not bag.path.is_dir():
        for part in list_parts(bag.path)[1:]:
            with open_bag(part) as following:
                names |= set(following.file_names)
    return names


def _report_foreign(options: argparse.Namespace) -> int:
    from agribot.record.foreign import read_foreign
    from agribot.record.foreign_page import write_foreign_report

    data = read_foreign(options.recording)
    localized, why = _try_filter(options.recording)
    if why:
        data = msgspec.structs.replace(data, missing=(*data.missing, f"poses: {why}"))
    summary = write_foreign_report(options.out, options.recording, data, localized)
    for word in (*data.missing, *data.notes):
        sys.stderr.write(f"missing: {word}\n" if word in data.missing else f"note: {word}\n")
    if options.json:
        sys.stdout.write(msgspec.json.encode(summary).decode() + "\n")
    else:
        sys.stdout.write(f"{options.out}/report.html\n")
    return 0


def _try_filter(recording: Path) -> tuple[Localized | None, str]:
    """Run the filter over a recording; return what came of it, or why it could not be done."""
    from agribot.app.localization.study import StudyOptions, open_study, run_study

    try:
        study = open_study([recording], StudyOptions())
        return (run_study(study), study.facts), ""
    except AgribotError as error:
        return None, str(error)
