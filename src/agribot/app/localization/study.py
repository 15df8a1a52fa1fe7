"""A log from its files to its figures: scan, checks, mounting, robot, and passes of the filter."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np

from agribot.app.calibration.recorded_robot import read_measured_robot
from agribot.app.localization.batches import make_batches
from agribot.app.localization.imu_mount import ImuMount
from agribot.app.localization.localize import LogPass, Tap, localize
from agribot.app.localization.log import LogEntry, LogSensor, RobotLog, TwistSample
from agribot.app.localization.log_checks import check_scan
from agribot.app.localization.log_files import find_own_recording, open_log
from agribot.app.localization.log_robot import (
    allow_speeds,
    find_way_ratio,
    fit_wheels,
    place_antenna,
    set_wheels,
)
from agribot.app.localization.log_scan import LogScan, count_entries, scan_log
from agribot.app.localization.mounting import (
    choose_mag_mount,
    choose_mount,
    find_in_base,
    list_mount_notes,
)
from agribot.app.localization.time_order import RestampedLog, order_by_stamp
from agribot.core.config import RunConfig, assign, from_tree
from agribot.core.errors import ConfigError
from agribot.core.geo import Datum
from agribot.core.messages import SensorBatch, Vec3
from agribot.core.robot import RobotSpec
from agribot.core.toml_tree import drop_none
from agribot.description.loader import load_robot
from agribot.record.localization.result import LocalizationRun, LogFacts, SourceFact
from agribot.record.replay import read_config

Progress = Callable[[int], None]
# Passes over a log for wheels that are not stated, and the change of their radius that ends them.
FIT_ROUNDS, FITTED_RATIO = 3, 0.01
DEFAULT_ROBOT = "agribot"
# Our own recordings hold the IMU in the body's axes.
IN_BODY = ImuMount(body_from_imu=np.eye(3), how="of the recording")
_GROUPS = ("estimate", "field")  # groups of the filter's settings


class StudyOptions(msgspec.Struct, frozen=True, kw_only=True):
    """A person's statements on a log and its robot; None: found, or the default."""

    named: dict[LogSensor, str] = {}
    robot: str | None = None
    track_m: float | None = None
    radius_m: float | None = None
    antenna_body_m: Vec3 | None = None
    imu_rpy_deg: Vec3 | None = None
    ticks_per_turn: float | None = None
    outages: tuple[tuple[float, float], ...] = ()
    settings: tuple[str, ...] = ()
    uses_log_times: bool = False


class Study(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A log that was scanned, with all that its passes need."""

    log: RobotLog
    scan: LogScan
    mount: ImuMount
    mag_mount: ImuMount
    robot: RobotSpec
    config: RunConfig
    options: StudyOptions
    facts: LogFacts
    base: RunConfig | None = None  # settings of a recording of this program
    way_ratio: float = 1.0  # divisor of the odometry's speeds


def open_study(
    paths: Sequence[Path],
    options: StudyOptions,
    make_progress: Callable[[int], Progress] = lambda total: lambda done: None,
) -> Study:
    """Open and scan a log.

    Raises: RecordingError: no log, or one that gives no pose. ConfigError, DescriptionError: what
    is stated does not fit.
    """
    own = find_own_recording(paths)
    base = None if own is None else read_config(own)
    config = make_config(options.settings, base)
    log = open_log(paths, options.named, options.ticks_per_turn)
    log = RestampedLog(log) if options.uses_log_times else log
    robot = set_wheels(_load_robot(options, own, base), options.track_m, options.radius_m)
    progress = make_progress(sum(each.count for each in log.channels))
    scan = scan_log(log, robot.drive, progress)
    fitted: tuple[str, ...] = ()
    if scan.has_wheels and own is None and options.robot is None:
        robot, scan, fitted = _fit_wheels(log, robot, scan, options, progress)
    notes = [*check_scan(log, scan), *fitted]
    frames = log.read_transforms()
    way_ratio = 1.0 if own is not None else find_way_ratio(scan)
    if way_ratio != 1.0:
        notes.append(f"odometry: its speeds are divided by {way_ratio:.2f}, as the fixes show")
    mount = IN_BODY if own is not None else choose_mount(scan, options.imu_rpy_deg, frames, notes)
    mag_mount = mount if own is not None else choose_mag_mount(scan, mount, frames, notes)
    is_known = options.robot is not None or own is not None
    pose = None if is_known else find_in_base(frames, scan.main_frame("gnss"))
    robot, antenna = place_antenna(robot, options.antenna_body_m, pose, is_known=is_known)
    drive = allow_speeds(robot.drive, scan.most_mps, scan.most_radps)
    robot = msgspec.structs.replace(robot, drive=drive)
    if "mag" not in scan.sensors:  # the filter would wait for it
        robot = msgspec.structs.replace(robot, mag=None)
    facts = LogFacts(
        name=", ".join(path.name for path in paths),
        start_stamp_s=scan.start_s,
        sources=tuple(_list_sources(log, scan)),
        mount=f"{mount.axes} ({mount.how})",
        robot=(_describe_wheels(robot, scan, options, is_known=is_known), antenna),
        notes=tuple(dict.fromkeys([*log.notes, *notes, *list_mount_notes(mount)])),
    )
    study = Study(
        log=log, scan=scan, mount=mount, mag_mount=mag_mount, robot=robot, options=options,
        facts=facts, base=base, config=config, way_ratio=way_ratio,
    )  # fmt: skip
    return msgspec.structs.replace(study, config=_put_datum(config, study))


def _fit_wheels(
    log: RobotLog, robot: RobotSpec, scan: LogScan, options: StudyOptions, progress: Progress
) -> tuple[RobotSpec, LogScan, tuple[str, ...]]:
    """Find wheels that are not stated; the better the track, the better the radius."""
    words: tuple[str, ...] = ()
    for _ in range(FIT_ROUNDS):
        before = robot.drive
        robot, words = fit_wheels(
            robot, scan, has_radius=options.radius_m is not None,
            has_track=options.track_m is not None,
        )  # fmt: skip
        if not words:
            break
        scan = scan_log(log, robot.drive, progress)
        if abs(robot.drive.wheel_radius_m / before.wheel_radius_m - 1.0) < FITTED_RATIO:
            break
    return robot, scan, words


def _load_robot(options: StudyOptions, own: Path | None, base: RunConfig | None) -> RobotSpec:
    if options.robot is None and own is not None and base is not None:
        return read_measured_robot(own, base)
    return load_robot(options.robot or DEFAULT_ROBOT)


def _describe_wheels(
    robot: RobotSpec, scan: LogScan, options: StudyOptions, *, is_known: bool
) -> str:
    if not scan.has_wheels:
        return "wheels: the odometry states speeds, their size is not needed"
    is_stated = options.track_m is not None and options.radius_m is not None
    how = "as stated" if is_stated else "see the notes"
    if is_known:
        how = f"of robot {robot.name}"
    drive = robot.drive
    return (
        f"wheels of {drive.wheel_radius_m:.3f} m radius, {drive.effective_separation_m:.2f} m "
        f"apart ({how})"
    )


def _list_sources(log: RobotLog, scan: LogScan) -> Iterator[SourceFact]:
    for channel in log.channels:
        times = scan.sensors.get(channel.sensor)
        if times is not None:
            yield SourceFact(
                sensor=channel.sensor,
                source=channel.source,
                kind=channel.kind,
                messages=times.count,
                measurements=times.samples,
                from_s=times.first_s - scan.start_s,
                to_s=times.last_s - scan.start_s,
            )


def run_study(
    study: Study,
    changes: Sequence[str] = (),
    taps: Sequence[Tap] = (),
    on_progress: Progress = lambda done: None,
) -> list[LocalizationRun]:
    """Run the filter over the log: as it is and, where there are `changes`, with these as well.

    Raises: RecordingError: the log cannot be read to its end. ConfigError: no such setting.
    """
    configs = [study.config]
    if changes:
        settings = (*study.options.settings, *changes)
        configs.append(_put_datum(make_config(settings, study.base), study))
    passes = [LogPass(config, study.robot, study.options.outages) for config in configs]
    localize(_make_batches(study, on_progress), passes, taps)
    fixes = study.scan.sensors["gnss"].frames[study.scan.main_frame("gnss")]
    base = study.options.settings
    return [
        one.finish(fixes, settings)
        for one, settings in zip(passes, (base, (*base, *changes)), strict=False)
    ]


def _make_batches(study: Study, on_progress: Progress) -> Iterator[SensorBatch]:
    frame, frames = study.scan.main_frame("gnss"), study.scan.sensors["gnss"].frames
    entries = (
        entry
        for entry in order_by_stamp(count_entries(study.log.entries(), on_progress))
        if len(frames) < 2 or entry.sensor != "gnss" or entry.frame == frame
    )
    if study.way_ratio != 1.0:
        entries = (_scale_way(entry, 1.0 / study.way_ratio) for entry in entries)
    mounts = study.mount, study.mag_mount
    return make_batches(entries, study.scan.start_s, mounts, study.robot.drive)


def _scale_way(entry: LogEntry, ratio: float) -> LogEntry:
    """Scale the speed of an odometry; other samples stay as they are."""
    sample = entry.sample
    if not isinstance(sample, TwistSample):
        return entry
    return entry._replace(sample=msgspec.structs.replace(sample, v_mps=ratio * sample.v_mps))


def make_config(settings: Sequence[str], base: RunConfig | None = None) -> RunConfig:
    """Make the settings of the filter, those of a recording or the defaults, with `a.b=c` on top.

    Raises: ConfigError: no such setting, or one that the filter has not.
    """
    tree = drop_none(msgspec.to_builtins(base or RunConfig(profile="log")))
    for setting in settings:
        group = setting.partition("=")[0].split(".")[0].strip()
        if group not in _GROUPS:
            raise ConfigError(
                f"{setting}: it has no effect on a log; settings of the filter begin with "
                f"{' or '.join(f'{each}.' for each in _GROUPS)}"
            )
        assign(tree, setting)
    return from_tree(tree, " ".join(settings))


def _put_datum(config: RunConfig, study: Study) -> RunConfig:
    """Put the origin of the map at the first fix; a recording of ours has one."""
    fix = study.scan.first_fix
    if fix is None or study.base is not None:
        return config
    datum = Datum(lat_deg=fix.lat_deg, lon_deg=fix.lon_deg, alt_m=fix.alt_m)
    field = msgspec.structs.replace(config.field, datum=datum)
    return msgspec.structs.replace(config, field=field)
