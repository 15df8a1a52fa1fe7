"""One mission of many kilometres over a square field without crop, with RTK and no camera."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from time import monotonic as read_clock
from typing import TYPE_CHECKING, Any

import msgspec

from agribot.app.mission_file import continue_config, read_mission
from agribot.app.run_folder import clear_run
from agribot.app.whole_job import read_job
from agribot.app.workers import Stop
from agribot.autonomy.plan.coverage.area import FieldArea, PlanRequest
from agribot.autonomy.plan.coverage.drive import MAX_LENGTH_M
from agribot.autonomy.plan.coverage.plan_certificate import certify_plan
from agribot.autonomy.plan.coverage.planner import plan_field
from agribot.autonomy.plan.mission.errand_kind import ErrandKind
from agribot.autonomy.plan.mission.saved_mission import SavedMission
from agribot.autonomy.plan.ways.footprint import measure_footprint
from agribot.core.config import load
from agribot.core.errors import ConfigError, MissionError, describe_range
from agribot.core.messages import ControlMission, Inbox, TickRecord, Who
from agribot.description.loader import load_robot
from agribot.gis.plan_file import SavedPlan, format_plan
from agribot.lab.sweep.execution import Assignment, RunOutcome, drive_run
from agribot.lab.sweep.plan import SweepJob
from agribot.record.report import Report

if TYPE_CHECKING:
    from agribot.app.simulated_run import SimulatedRun

PROFILE, PRESET = "farm", "field"
WIDTH_M = 1.0  # width of a pass: the path in m is about the area in m²
MARGIN_M = 0.3
INSIDE_M = 5.0  # distance of the start from two edges
LEAST_KM = 0.05
REPORT_PERIOD_S = 5.0
MOST_CHARGES = 100  # charges of a mission of 100 km at most; a charge carries some 11 km
FIXED = (
    "world=empty", "field.start_map_m=[0,0]", f"sim.preset={PRESET}", "sim.sensors=rtk",
    "perception.enabled=false", "record.enabled=false",
)  # fmt: skip


def make_plan(km: float) -> str:
    """Make a certified plan of about `km` kilometres, as the text of its file.

    Raises: ConfigError: it is shorter than a field is, or longer than a mission can be.
    """
    if not LEAST_KM <= km <= MAX_LENGTH_M / 1000.0:
        raise ConfigError(f"--km {km:g}: {describe_range(LEAST_KM, MAX_LENGTH_M / 1000.0, 'km')}")
    side_m = math.sqrt(1000.0 * km * WIDTH_M)
    low_m, high_m = -INSIDE_M, side_m - INSIDE_M
    area = FieldArea(boundary=((low_m, low_m), (high_m, low_m), (high_m, high_m), (low_m, high_m)))
    config, robot = load(PROFILE), load_robot()
    request = PlanRequest(implement_width_m=WIDTH_M, tool_x_m=robot.tool_x_m, margin_m=MARGIN_M)
    shape = measure_footprint(robot, WIDTH_M)
    plan = plan_field(area, shape, request)
    certificate = certify_plan(plan, area, shape, request)
    return format_plan(SavedPlan(plan, area, request, config.field.datum), certificate)


def list_jobs(
    km: float, plan: Path, seeds: Sequence[int], speed_mps: float | None = None
) -> tuple[SweepJob, ...]:
    """List a mission for each seed over the plan in a file.

    Raises: ConfigError: the speed is out of range for a mission.
    """
    speed = () if speed_mps is None else (f"mission.speed_mps={speed_mps:g}",)
    fixed = (*FIXED, f"plan={plan}", *speed)
    jobs = tuple(
        SweepJob(name=f"{km:g}km-seed-{seed}", profile=PROFILE, seed=seed, fixed=fixed,
                 settings=())
        for seed in seeds
    )  # fmt: skip
    for job in jobs:
        job.config()
    return jobs


def go_on(assignment: Assignment, stop: Stop) -> RunOutcome | None:
    """Drive a mission to its end from where it was cut off, if it was; None where it is again.

    A robot that came home for its battery is charged there, and goes on with its work, up to
    MOST_CHARGES times and unless a whole charge brought it no farther.
    """
    come_m = -1.0
    for _ in range(MOST_CHARGES + 1):
        outcome = drive_run(assignment.job, lambda: _open(assignment), stop)
        saved = _read_last(assignment.out_dir)
        if outcome is None or outcome.report is None or saved is None:
            break
        if not (_is_home_to_be_charged(saved) and saved.s_m > come_m):
            break
        come_m = saved.s_m
    return outcome


def _open(assignment: Assignment) -> SimulatedRun:
    """Open the next part of a mission, a run of its own that resumes the job."""
    from agribot.app.simulated_run import simulate

    config, parts = assignment.job.config(), list_parts(assignment.out_dir)
    saved = _read_last(assignment.out_dir)
    if saved is None:
        for part in parts:
            clear_run(part)
        return simulate(config, assignment.out_dir)
    if _is_home_to_be_charged(saved):
        saved = msgspec.structs.replace(saved, errand=None)
    earlier, out_dir = read_job(parts[-1], saved), _name_part(assignment.out_dir, len(parts) + 1)
    session = simulate(continue_config(config, saved), out_dir, saved, earlier)
    if saved.asks_first:
        session.add_tap(_Charger(session.inbox))
    return session


class _Charger:
    """A tap that resumes a robot paused for charging, once, as an operator would."""

    def __init__(self, inbox: Inbox) -> None:
        self._inbox: Inbox | None = inbox

    def __call__(self, record: TickRecord) -> None:
        if self._inbox is not None and record.status.state == "paused":
            self._inbox.post(ControlMission(action="resume"), Who("the person who charged it"))
            self._inbox = None


def _read_last(out_dir: Path) -> SavedMission | None:
    """Read a mission as its last part left it; None where it cannot go on: not begun, or done."""
    try:
        return read_mission(list_parts(out_dir)[-1])
    except MissionError:
        return None


def _is_home_to_be_charged(saved: SavedMission) -> bool:
    came_home = saved.errand is not None and saved.errand.to is ErrandKind.CHARGE
    return came_home and saved.state == "cancelled"


def list_parts(out_dir: Path) -> list[Path]:
    """List the folders of an interrupted mission; the first need not exist."""
    parts = [out_dir]
    while (part := _name_part(out_dir, len(parts) + 1)).exists():
        parts.append(part)
    return parts


def _name_part(out_dir: Path, number: int) -> Path:
    return out_dir.with_name(f"{out_dir.name}.{number}")


class ProgressLine:
    """Says, every few seconds, how far the missions that are on their way have come."""

    def __init__(self, folders: Sequence[Path]) -> None:
        self._folders = folders
        self._reported_s = read_clock()

    def __call__(self) -> str:
        """Return the ways, or nothing where it is not yet time."""
        if read_clock() - self._reported_s < REPORT_PERIOD_S:
            return ""
        self._reported_s = read_clock()
        return ", ".join(filter(None, map(_describe_progress, self._folders)))


def _describe_progress(out_dir: Path) -> str:
    saved = _read_last(out_dir)
    return f"{saved.s_m / 1000.0:.2f} of {saved.length_m / 1000.0:.2f} km" if saved else ""


def summarise(reports: Sequence[Report]) -> dict[str, Any]:
    """Sum up way, time, what needed a person, and what the missions cost.

    `memory_mb` is the most that a process of this command has held; None on Windows.
    """
    km = sum(report.mission.distance_m or 0.0 for report in reports) / 1000.0
    count = sum(len(report.safety.interventions) for report in reports)
    return {
        "missions": len(reports),
        "km": km,
        "hours": sum(report.time.sim_s or 0.0 for report in reports) / 3600.0,
        "interventions": count,
        "km_per_intervention": km / count if count else None,
        "outside_m_max": max((r.safety.outside_m_max or 0.0 for r in reports), default=None),
        "cpu_s": sum(report.time.cpu_s or 0.0 for report in reports),
        "memory_mb": _find_peak_mb(),
    }


def _find_peak_mb() -> float | None:
    """Find the peak memory of a process of this command; None on Windows."""
    try:
        import resource
    except ImportError:
        return None
    whose = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return max(resource.getrusage(who).ru_maxrss for who in whose) / 1024.0
