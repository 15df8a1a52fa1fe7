"""What the robot would not notice without each of its witnesses.

`nice -n 10 python benchmarks/witnesses.py FOLDER [--seeds 1] [--workers 2] [--camera] [--most N]`.
Each drive of `agribot bench faults --in-row` is driven as the robot is, and once more without each
witness that found something in it (the first N drives of each). FOLDER gets `drives.jsonl`, so that
a second call drives only what is missing, and `witnesses.csv`. A witness in whose absence nothing
is lost in any drive is not needed.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import AbstractContextManager, ExitStack, contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from agribot.autonomy.estimate import doubts
from agribot.autonomy.estimate.filter import lateness
from agribot.autonomy.estimate.sensors import gnss_noise, gnss_velocity, row_line_noise
from agribot.autonomy.estimate.witnesses import (
    antenna_watch,
    carry_watch,
    course_check,
    crop_watch,
    drift_watch,
    fitness_watch,
    fix_watch,
    mirror_watch,
    picture_flow,
    picture_watch,
    row_agreement,
    row_identity,
    row_line_watch,
    scene_watch,
    slow_creep,
    spin_watch,
    start_agreement,
    turn_watch,
)
from agribot.cli.standard_error import print_line
from agribot.lab.bench.fault_rows import FaultRow, make_rows
from agribot.lab.bench.faults import (
    FaultScenario,
    choose_scenarios,
    drive_scenario,
    leave_out_fault,
    list_fault_names,
    list_jobs,
)
from agribot.lab.sweep.execution import Assignment
from agribot.lab.sweep.plan import SweepJob
from agribot.record.report import Report

# Delay of what is noticed, s, and way outside the field, m, that count as a loss.
LATER_S, OUTSIDE_M = 1.0, 0.05


class Watch(NamedTuple):
    """A witness by where it speaks: an attribute of its owner, and what that gives in its absence.

    `found` says of the owner, and of what the attribute gave, whether something was found.
    """

    name: str
    owner: Any
    attribute: str
    absent: Any = None
    found: Callable[[Any, Any], bool] = lambda _owner, result: bool(result)


def has_fault(owner: Any, _result: Any) -> bool:
    return owner.fault is not None


def has_named(owner: Any, _result: Any) -> bool:
    return bool(max(owner._gyro_s, owner._compass_s) > 0.0)


WATCHES = (
    Watch("antenna elsewhere", antenna_watch.AntennaWatch, "off_m", 0j),
    Watch("carried", carry_watch.CarryWatch, "find"),
    Watch("first heading against courses", course_check.CourseCheck, "add", None, has_fault),
    Watch("crop unknown", crop_watch.CropWatch, "fault"),
    Watch("fixes that creep", drift_watch.DriftWatch, "_find_creep", None),
    Watch("fixes that creep slowly", slow_creep.SlowCreep, "_judge", None, has_fault),
    Watch("pictures unfit", fitness_watch.FitnessWatch, "hear", None, has_fault),
    Watch("fixes that repeat", fix_watch.RepeatWatch, "is_repeat", False, has_fault),
    Watch("fixes that jump", fix_watch.JumpWatch, "is_jump", False),
    Watch("picture mirrored", mirror_watch.MirrorWatch, "add", None, has_fault),
    Watch("picture upside down", picture_flow.PictureFlow, "add", None, has_fault),
    Watch("picture frozen", picture_watch.PictureWatch, "is_stale", False),
    Watch("rows against fixes", row_agreement.RowAgreement, "_evaluate", None, has_fault),
    Watch("which row", row_identity.RowIdentity, "doubt"),
    Watch("row lines that move", row_line_watch.RowLineWatch, "_find_move"),
    Watch("no picture", scene_watch.SceneWatch, "silence"),
    Watch("pictures late", scene_watch.SceneWatch, "lateness"),
    Watch("wheels that spin", spin_watch.SpinWatch, "is_spinning", False),
    Watch("wheels that lost their way", gnss_velocity, "have_lost_way", False),
    Watch("claims at the start", start_agreement.StartAgreement, "_find_fault"),
    Watch("gyro, compass and wheels", turn_watch.TurnWatch, "_vote", None, has_named),
    Watch("positions scatter", gnss_noise.PositionNoise, "fault"),
    Watch("velocities scatter", gnss_noise.VelocityNoise, "fault"),
    Watch("row lines scatter", row_line_noise.RowLineNoise, "fault"),
    Watch("fixes rejected", doubts.Doubts, "_count_rejected"),
    Watch("IMU late", lateness.Lateness, "fault"),
    Watch("clock leapt", lateness.LeapWatch, "fault"),
)
BY_NAME = {watch.name: watch for watch in WATCHES}


class Drive(msgspec.Struct, frozen=True, kw_only=True):
    """A drive of the campaign `without` a witness, or as the robot is, and what found something."""

    job: str
    without: str
    found: tuple[str, ...] = ()
    report: Report | None = None
    error: str = ""


Drives = dict[tuple[str, str], Drive]


class Task(NamedTuple):
    """A drive to be driven, and a folder for its files."""

    job: SweepJob
    without: str
    folder: Path


@contextmanager
def replace(
    watch: Watch, make: Callable[[Callable[..., Any]], Callable[..., Any]]
) -> Iterator[None]:
    """Put what `make` makes of it in place of that through which a witness speaks."""
    owner, name = watch.owner, watch.attribute
    was = owner.__dict__[name]
    is_property = isinstance(was, property)
    now = make(was.fget if is_property else was)
    setattr(owner, name, property(now) if is_property else now)
    try:
        yield
    finally:
        setattr(owner, name, was)


def listen(watch: Watch, found: set[str]) -> AbstractContextManager[None]:
    """Add a witness to `found` once it finds something."""

    def make(ask: Callable[..., Any]) -> Callable[..., Any]:
        def hear(*args: Any, **kwargs: Any) -> Any:
            result = ask(*args, **kwargs)
            if watch.found(args[0], result):
                found.add(watch.name)
            return result

        return hear

    return replace(watch, make)


def leave_out(watch: Watch) -> AbstractContextManager[None]:
    return replace(watch, lambda _: lambda *_args, **_kwargs: watch.absent)


def drive(task: Task) -> Drive:
    """Drive one drive, without a witness or listening to all of them."""
    found: set[str] = set()
    with ExitStack() as stack:
        if task.without:
            stack.enter_context(leave_out(BY_NAME[task.without]))
        else:
            for watch in WATCHES:
                stack.enter_context(listen(watch, found))
        outcome = drive_scenario(Assignment(job=task.job, out_dir=task.folder), lambda: False)
    return Drive(
        job=task.job.name,
        without=task.without,
        found=tuple(sorted(found)),
        report=outcome.report if outcome else None,
        error=outcome.error if outcome else "stopped",
    )


class Kept:
    """The drives of a folder."""

    def __init__(self, folder: Path, workers: int) -> None:
        self._folder, self._workers = folder, workers
        self._path = folder / "drives.jsonl"
        folder.mkdir(parents=True, exist_ok=True)

    def drive_missing(self, jobs: Sequence[tuple[SweepJob, str]]) -> Drives:
        """Drive what is missing of these jobs, each without a witness or "", and return all."""
        done = self._read()
        tasks = [
            Task(job, without, self._folder / f"{job.name}-{without}".replace(" ", "-"))
            for job, without in jobs
            if (job.name, without) not in done
        ]
        with ProcessPoolExecutor(self._workers, mp_context=get_context("spawn")) as pool:
            futures = [pool.submit(drive, task) for task in tasks]
            for number, future in enumerate(as_completed(futures), 1):
                one = future.result()
                with self._path.open("ab") as file:
                    file.write(msgspec.json.encode(one) + b"\n")
                print_line(f"{number} of {len(tasks)}: {one.job} {one.without}")
        return self._read()

    def _read(self) -> Drives:
        lines = self._path.read_bytes().splitlines() if self._path.exists() else []
        drives = (msgspec.json.decode(line, type=Drive) for line in lines)
        return {(one.job, one.without): one for one in drives}


def list_losses(as_is: FaultRow, without: FaultRow) -> Iterator[str]:
    """List what is worse without a witness."""
    later_s = (without.time_to_detect_s or 0.0) - (as_is.time_to_detect_s or 0.0)
    if without.noticed < as_is.noticed:
        yield "not noticed"
    elif without.noticed and later_s > LATER_S:
        yield f"noticed {later_s:.0f} s later"
    if without.noticed and without.named < as_is.named:
        yield "another part named"
    if (more := (without.crushed_after or 0) - (as_is.crushed_after or 0)) > 0:
        yield f"{more} plants crushed"
    if (without.outside_m_max or 0.0) > (as_is.outside_m_max or 0.0) + OUTSIDE_M:
        yield f"{without.outside_m_max:.1f} m outside"
    if without.noticed >= as_is.noticed and without.reaction != as_is.reaction:
        yield f"{without.reaction} instead of {as_is.reaction}"


def tabulate(
    scenarios: Sequence[FaultScenario], jobs: Sequence[SweepJob], done: Drives
) -> Iterator[tuple[str, str, str, str]]:
    """Tabulate witness, drive, fault and loss."""
    for watch in WATCHES:
        for job in jobs:
            one, as_is = done.get((job.name, watch.name)), done[job.name, ""]
            if one is None or one.report is None or as_is.report is None:
                continue
            found = next(s for s in scenarios if _is_of(job, s))
            before, after = (_make_row(found, jobs, r, done) for r in (as_is, one))
            loss = ", ".join(list_losses(before, after)) or "nothing"
            yield watch.name, found.drive, found.name, loss


def _is_of(job: SweepJob, scenario: FaultScenario) -> bool:
    return (scenario.profile, scenario.list_settings()) == (job.profile, job.settings)


def _make_row(
    scenario: FaultScenario, jobs: Sequence[SweepJob], one: Drive, done: Drives
) -> FaultRow:
    usual = leave_out_fault(scenario)
    reports: Mapping[str, Report | None] = {
        job.name: done[job.name, ""].report for job in jobs if _is_of(job, usual)
    } | {one.job: one.report}
    return make_rows((scenario,), jobs, {k: r for k, r in reports.items() if r is not None})[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", default="1")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--camera", action="store_true")
    parser.add_argument("--most", type=int)
    options = parser.parse_args()
    scenarios = choose_scenarios(list_fault_names(), options.camera)
    jobs = list_jobs(scenarios, options.seeds)
    kept = Kept(options.folder, options.workers)
    done = kept.drive_missing([(job, "") for job in jobs])
    finds = {name: [job for job in jobs if name in done[job.name, ""].found] for name in BY_NAME}
    done = kept.drive_missing(
        [(job, name) for name, found in finds.items() for job in found[: options.most]]
    )
    with (options.folder / "witnesses.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(("witness", "drive", "fault", "without it"))
        table.writerows(tabulate(scenarios, jobs, done))


if __name__ == "__main__":
    main()
