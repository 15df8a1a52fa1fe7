"""The campaign of faults: what the robot notices, what it does about it, and what it costs.

Every scenario is a drive into a row in which one thing goes wrong; it ends some time after that,
or when the robot stands for good. Beside them the same drives without any fault are judged: what
stops the robot there is a false alarm.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from agribot.app.run_folder import clear_run
from agribot.app.workers import Stop, results
from agribot.core.errors import AgribotError, ConfigError
from agribot.lab.sweep.execution import Assignment, RunOutcome
from agribot.lab.sweep.plan import SweepJob, read_seeds
from agribot.sim.faults.schedule import parse_fault, read_faults
from agribot.sim.faults.table import FAULTS

PRESET = "field"  # differences of the world from its map and from seed to seed
AFTER_S = 45.0
STANDS_S = 5.0  # a robot that stands for this time and waits for a person has ended
STANDING_MPS = 0.02
IN_ROW_S = {"rows-10x12": 20.0, "farm": 32.0, "hills": 32.0, "beet": 20.0}
DEFAULT_SEEDS = "1-5"
# Faults of the motor board, of the parts wired to it and of its line.
BELOW_THE_STACK = (
    "imu",
    "mag",
    "wheels",
    "motor",
    "bumper",
    "button",
    "battery",
    "board",
    "link",
    "contactor",
    "inputs",
    "program",
)
PLATFORMS = ("sim", "firmware")
ENDED = "ended by an error: "
# Time until the robot holds evidence of a fault, s; crops crushed after it are avoidable.
DETECTABLE_S = {"gnss.drift": 10.0, "battery.empty": 5.0, "obstacle.unmapped": 5.0}
DETECTABLE_IN_S = 3.0  # time limit of all others
# Cases of two sensors that lie at once, judged one by one.
SPECIAL = ("gnss.wrong_fix=0.2", "gnss.wrong_fix=0.4", "gnss.wrong_fix=1", "gnss.frozen",
           "gnss.drift=0.05", "start.aside=1", "start.turned=30", "crop.gap=5")  # fmt: skip


class FaultScenario(NamedTuple):
    """A fault without its time, empty for none, and the drive in which it happens.

    `is_detectable` is false where no part on board can distinguish the fault from normal operation.
    """

    fault: str
    profile: str = "rows-10x12"
    sensors: str = "rtk"
    has_camera: bool = False
    lasts_s: float | None = None
    is_detectable: bool = True
    also: str = ""  # a second fault in the same moment
    platform: str = "sim"  # `sim`, or `firmware`, the simulator on the motor board's real program

    @property
    def faults(self) -> tuple[str, ...]:
        return tuple(filter(None, (self.fault, self.also)))

    @property
    def name(self) -> str:
        """Name the scenario in tables; every one is another."""
        lasting = f"+{self.lasts_s:g}" if self.lasts_s else ""
        return f"{' and '.join(self.faults)}{lasting}" if self.fault else "no fault"

    @property
    def drive(self) -> str:
        return name_drive(self.profile, self.sensors, self.platform, has_camera=self.has_camera)

    @property
    def is_special(self) -> bool:
        """Whether it is one of the cases that are looked at one by one."""
        return bool(self.also) or self.fault in SPECIAL

    @property
    def detectable_in_s(self) -> float:
        """Time from its start until the sensors on board hold evidence of the fault."""
        names = [fault.partition("=")[0] for fault in self.faults]
        return max((DETECTABLE_S.get(name, DETECTABLE_IN_S) for name in names), default=0.0)

    def list_settings(self) -> tuple[str, ...]:
        """List the settings that make this drive."""
        in_row_s = IN_ROW_S[self.profile]
        lasting = f"+{self.lasts_s:g}" if self.lasts_s else ""
        kinds = [parse_fault(f"{fault}@0").kind for fault in self.faults]
        begin_s = [0.0 if kind.at_start else in_row_s for kind in kinds]
        pairs = zip(self.faults, begin_s, strict=True)
        texts = ", ".join(f'"{fault}@{t_s:g}{lasting}"' for fault, t_s in pairs)
        is_recorded = any(kind.part == "disk" for kind in kinds)
        return (
            f"sim.preset={PRESET}",
            f"sim.sensors={self.sensors}",
            f"perception.enabled={str(self.has_camera).lower()}",
            f"record.enabled={str(is_recorded).lower()}",
            f"duration_s={in_row_s + AFTER_S:g}",
            f"faults=[{texts}]",
            f"platform={self.platform}",
            *(('safety.must_report=["red button"]',) if "inputs.silent" in self.faults else ()),
        )


def name_drive(profile: str, sensors: str, platform: str, *, has_camera: bool) -> str:
    camera = " camera" if has_camera else ""
    return f"{profile} {sensors}{camera}{'' if platform == 'sim' else f' {platform}'}"


def _all(faults: str, **drive: Any) -> tuple[FaultScenario, ...]:
    return tuple(FaultScenario(fault, **drive) for fault in faults.split())


SCENARIOS = (
    *_all("gnss.outage gnss.jump=0.1 gnss.jump=0.5 gnss.jump=2 gnss.jump=100"),
    FaultScenario("gnss.outage", lasts_s=8.0),
    *_all("gnss.wrong_fix=0.2 gnss.wrong_fix=0.4 gnss.wrong_fix=1 gnss.wrong_fix=2"),
    FaultScenario("gnss.drift=0.01", is_detectable=False),
    *_all("gnss.drift=0.05 gnss.drift=0.5 gnss.frozen gnss.velocity=10 gnss.velocity=100"),
    *_all("gnss.scatter=3 gnss.scatter=10"),
    *_all("gnss.outage gnss.wrong_fix=0.5 gnss.frozen", sensors="rtk-dual"),
    *_all("mag.motor mag.offset=5 mag.offset=30"),
    *_all("imu.bias=0.01 imu.bias=0.05 imu.bias=0.3 imu.frozen"),
    *_all("imu.late=0.1 imu.late=0.25 imu.late=1"),
    *_all("wheels.stuck=right_wheel_R wheels.stuck=left_wheel_F wheels.reversed"),
    *_all("motor.dead=right_wheel_R motor.dead=left_wheel_F motor.weak=0.005"),
    FaultScenario("motor.weak=0.05", is_detectable=False),  # it is never asked for more in a row
    *_all("motor.runaway soil.mud=0.1 soil.mud=0.03"),
    *_all("bumper.contact obstacle.unmapped battery.empty"),
    *_all("button.pressed imu.unplugged board.hung inputs.silent contactor.silent"),
    *_all("program.stalled=3 robot.tipped=40"),
    FaultScenario("contactor.welded", also="motor.runaway"),
    *_all("clock.step=0.2 clock.step=2 clock.step=-2 link.noise=0.01 link.noise=0.2"),
    *_all("board.silent disk.full start.aside=0.3 start.aside=1 start.turned=20"),
    *_all("start.turned=30 start.turned=90 carried=0.3 carried=1 crop.gap=5"),
    FaultScenario("gnss.drift=0.05", also="imu.bias=0.05"),
    FaultScenario("gnss.frozen", also="mag.offset=30"),
    FaultScenario("gnss.wrong_fix=0.4", also="imu.bias=0.05"),
    FaultScenario("gnss.outage", also="mag.offset=30"),
    *_all("gnss.outage gnss.drift=0.05 obstacle.unmapped carried=0.3", profile="farm"),
    *_all("motor.dead=left_wheel_F soil.mud=0.1 imu.bias=0.05", profile="hills"),
    *_all("camera.black camera.frozen camera.flipped camera.late=0.5 camera.late=2 camera.off "
          "network.hung gnss.outage gnss.wrong_fix=2 gnss.frozen mag.offset=30 crop.gap=5",
          sensors="m8n", has_camera=True),
    *_all("start.aside=1", sensors="m8n", has_camera=True),
    *_all("camera.shifted=0.2 camera.shifted=-0.3 camera.creeping=0.05 camera.mirrored",
          sensors="m8n", has_camera=True),
    *_all("camera.shifted=0.2 camera.creeping=0.05", has_camera=True),
    FaultScenario("camera.frozen", sensors="m8n", has_camera=True, also="gnss.wrong_fix=2"),
    *_all("gnss.wrong_fix=0.4 gnss.drift=0.01 camera.flipped obstacle.unmapped", has_camera=True),
    *_all("gnss.wrong_fix=0.2 gnss.wrong_fix=1 gnss.frozen gnss.drift=0.05 start.aside=1 "
          "start.turned=30 crop.gap=5", has_camera=True),
    FaultScenario("camera.frozen", has_camera=True, also="gnss.wrong_fix=0.4"),
)  # fmt: skip


def choose_scenarios(
    faults: Sequence[str],
    has_camera: bool | None,
    platform: str = "sim",
    *,
    is_special: bool = False,
) -> tuple[FaultScenario, ...]:
    """Choose the scenarios of these faults, and the drives without a fault beside them.

    `has_camera` None takes both kinds; `is_special` only what is looked at one by one.

    Raises: ConfigError: none is left.
    """
    chosen = [
        scenario._replace(platform=platform)
        for scenario in SCENARIOS
        if any(parse_fault(f"{fault}@0").name in faults for fault in scenario.faults)
        and has_camera in (None, scenario.has_camera)
        and (scenario.is_special or not is_special)
    ]
    if not chosen:
        kind = "with a camera" if has_camera else "without a camera"
        raise ConfigError(f"no scenario {kind} has {' or '.join(faults)}; name other faults")
    drives = dict.fromkeys(leave_out_fault(scenario) for scenario in chosen)
    return (*drives, *chosen)


def leave_out_fault(scenario: FaultScenario) -> FaultScenario:
    """Return the same drive without a fault."""
    return scenario._replace(fault="", also="", lasts_s=None, is_detectable=True)


def list_fault_names(platform: str = "sim") -> tuple[str, ...]:
    """List the faults of a platform; real firmware is tried by those at the board and below it."""
    names = (kind.name for kind in FAULTS)
    return tuple(n for n in names if platform == "sim" or n.split(".")[0] in BELOW_THE_STACK)


def list_jobs(scenarios: Sequence[FaultScenario], seeds: str) -> tuple[SweepJob, ...]:
    """List all runs, the first seed of every scenario before the second.

    Raises: ConfigError: a seed is not valid, or a scenario does not fit the program.
    """
    jobs = []
    for seed in read_seeds(seeds):
        for number, scenario in enumerate(scenarios):
            name = re.sub(r"[^A-Za-z0-9.+-]+", "_", f"{scenario.drive}-{scenario.name}")
            job = SweepJob(
                name=f"{seed}-{number:02d}-{name}", profile=scenario.profile, seed=seed,
                fixed=(), settings=scenario.list_settings(),
            )  # fmt: skip
            read_faults(job.config())
            jobs.append(job)
    return tuple(jobs)


def list_drives(
    count: int, has_camera: bool | None, platform: str = "sim"
) -> tuple[tuple[FaultScenario, ...], tuple[SweepJob, ...]]:
    """List `count` drives without a fault, in turns of the campaign's drives, and their kinds."""
    every = choose_scenarios(list_fault_names(platform), bool(has_camera), platform)
    drives = tuple(scenario for scenario in every if not scenario.fault)
    return drives, list_jobs(drives, f"1-{-(-count // len(drives))}")[:count]


class FaultExecutor:
    """`workers` processes; a run that ends in an error has a report, too."""

    def __init__(self, workers: int) -> None:
        self._workers = workers

    def run(self, assignments: Sequence[Assignment], stop: Stop) -> Iterator[RunOutcome]:
        done = results(drive_scenario, assignments, self._workers, stop)
        return (outcome for outcome in done if outcome is not None)


def drive_scenario(assignment: Assignment, stop: Stop) -> RunOutcome | None:
    """Drive until the robot's end or that of the time; None where it was stopped before.

    Raises: AgribotError: it could not even begin.
    """
    from agribot.app.report_card import report_card
    from agribot.app.simulated_run import simulate

    job, why = assignment.job, ""
    try:
        clear_run(assignment.out_dir)
        session = simulate(job.config(), assignment.out_dir)
    except AgribotError as error:
        return RunOutcome(job=job, error=str(error))
    with session:
        stood = 0.0
        try:
            for record in session.ticks():
                if stop():
                    return None
                status = record.status
                waits = bool(status.stopped or status.held) or status.state == "failed"
                stands = abs(session.simulator.truth().v_mps) < STANDING_MPS
                stood = stood + 1.0 / session.config.tick_hz if waits and stands else 0.0
                if stood > STANDS_S:
                    break
        except Exception as error:  # noqa: BLE001  what a fault may do to the program is a result
            is_known = isinstance(error, AgribotError)
            why = str(error) if is_known else f"program error: {type(error).__name__}: {error}"
            session.clock.stop()
        session.stack.perception.settle()
        report = report_card(session, f"{ENDED}{why}" if why else "")
    clear_run(assignment.out_dir)
    return RunOutcome(job=job, report=report)
