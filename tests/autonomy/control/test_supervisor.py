from __future__ import annotations

import math
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agribot.autonomy.control.fence import PathFence
from agribot.autonomy.control.supervise import Supervisor
from agribot.core.config import SafetyConfig
from agribot.core.facts import (
    CommandNotFinite,
    Fact,
    GnssJumped,
    HeadingUnsure,
    ImplementNotFinite,
    LeavesBox,
    MissionIdle,
    NoFixesYet,
    NoPosition,
    NotHeardYet,
    PositionNotFinite,
    PositionUnsure,
    Said,
    SensorNotFinite,
    SensorSilent,
    SpeedLimited,
    StoppedBy,
    StopToClear,
    Tilted,
    TiltUnknown,
    Unspoken,
    YawRateLimited,
)
from agribot.core.messages import (
    STOP,
    DriveCommand,
    Estimate,
    Goal,
    ImplementCommand,
    MissionState,
    MissionStatus,
    Path,
    RequestWord,
    RobotCommand,
    SensorBatch,
)  # fmt: skip
from agribot.core.robot import RobotSpec
from agribot.description.loader import load_robot
from tests.asking import BY_WORD, ask
from tests.autonomy.control.kinematic_rover import TICK_S, Rover, Soil
from tests.finding import holds
from tests.robot_parts import plain_rover

ROBOT = plain_rover()
SPOT = Path(
    xy_map_m=np.zeros((2, 2)), yaw_map_rad=np.zeros(2), curvature_radpm=np.zeros(2),
    row=np.zeros(2, dtype=np.int64), s_m=np.zeros(2),
)  # fmt: skip
FORWARD = DriveCommand(v_mps=0.4, yaw_rate_radps=0.2)
OPEN = ImplementCommand(sections_on=(True, False, True))


class Gate:
    """A supervisor with everything in order, so that a test can break one thing at a time."""

    def __init__(self, config: SafetyConfig | None = None, robot: RobotSpec = ROBOT) -> None:
        self.supervisor = Supervisor(config or SafetyConfig(), robot)
        self.implement = OPEN
        self.rover = Rover((0.0, 0.0, 0.0), Soil(), np.random.default_rng(0))

    def send(
        self,
        drive: DriveCommand = FORWARD,
        *,
        estimate: Estimate | None = None,
        batch: SensorBatch | None = None,
        state: MissionState = "running",
        actions: tuple[RequestWord, ...] = (),
        is_by_hand: bool = False,
    ) -> tuple[RobotCommand, Fact | None]:
        self.rover.t_s += TICK_S
        batch = batch or self.rover.batch()
        events = tuple(ask(BY_WORD[action], t_s=batch.t_s) for action in actions)
        batch = msgspec.structs.replace(batch, requests=events)
        command = self.command(drive)
        sent, reason = self.supervisor.check(
            command,
            estimate or self.rover.estimate(),
            batch,
            goal(state),
            is_by_hand=is_by_hand,
        )
        self.rover.turn_wheels(sent.drive)
        self.rover.yaw_rate_radps = sent.drive.yaw_rate_radps
        return sent, reason

    def command(self, drive: DriveCommand) -> RobotCommand:
        return RobotCommand(t_s=self.rover.t_s, drive=drive, implement=self.implement)

    def lost_estimate(self) -> Estimate:
        return msgspec.structs.replace(self.rover.estimate(), ok=False, fact=Said("no GNSS fix"))

    def cruise(self) -> Gate:
        for _ in range(50):
            sent, reason = self.send()
        assert (sent.drive, sent.implement, reason) == (FORWARD, OPEN, None)
        return self

    def believed(self, **changes: object) -> Estimate:
        return msgspec.structs.replace(self.rover.estimate(), **changes)


def goal(state: MissionState) -> Goal:
    status = MissionStatus(
        state=state, reason="why", row=0, rows_total=1, rows_done=(), s_m=0.0, length_m=1.0,
        waypoints_total=0, waypoints_reached=0, fact=Said("why"),
    )  # fmt: skip
    return Goal(path=SPOT, s_m=0.0, max_speed_mps=0.4, tool_on=True, status=status)


def assert_stopped(sent: RobotCommand, reason: Fact | None, *wanted: Fact | type[Fact]) -> None:
    assert sent.drive == STOP
    assert sent.implement.sections_on == (False, False, False)
    assert holds(reason, *wanted), reason


def test_a_good_command_passes_unchanged() -> None:
    Gate().cruise()


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({"ok": False, "fact": NoFixesYet()}, NoPosition(NoFixesYet())),
        ({"pos_std_m": 3.2}, PositionUnsure(3.2, 3.0)),
        ({"pos_std_m": math.nan}, PositionUnsure(math.nan, 3.0)),
        ({"contradiction_fact": GnssJumped(0.4)}, GnssJumped(0.4)),
        ({"yaw_std_rad": 0.7}, HeadingUnsure(0.7, 0.6)),
        ({"x_map_m": math.nan}, PositionNotFinite()),
        ({"yaw_map_rad": math.inf}, PositionNotFinite()),
        ({"x_map_m": 5.1}, LeavesBox(5.1, ANY, is_inside=False)),
        ({"y_map_m": -5.1}, LeavesBox(ANY, -5.1, is_inside=False)),
    ],
)
def test_an_estimate_that_cannot_be_trusted_stops_the_robot(
    changes: dict[str, object], wanted: Fact
) -> None:
    gate = Gate().cruise()
    assert_stopped(*gate.send(estimate=gate.believed(**changes)), wanted)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("part", ["v_mps", "yaw_rate_radps"])
def test_a_command_that_is_no_number_stops_the_robot(part: str, value: float) -> None:
    bad = msgspec.structs.replace(FORWARD, **{part: value})
    assert_stopped(*Gate().cruise().send(bad), CommandNotFinite)


def test_a_setpoint_of_the_implement_that_is_no_number_stops_the_robot() -> None:
    gate = Gate().cruise()
    gate.implement = msgspec.structs.replace(OPEN, setpoints={"depth_m": math.nan})
    assert_stopped(*gate.send(), ImplementNotFinite)


def test_backwards_only_an_implement_that_can_work_so_stays_on() -> None:
    back = DriveCommand(v_mps=-0.2)
    for name, works_backwards in (("agribot", True), ("agribot-hoe", False)):
        gate = Gate(robot=load_robot(name)).cruise()
        for _ in range(100):
            sent, reason = gate.send(back)
        assert (sent.drive, reason) == (back, None)
        assert sent.implement == (OPEN if works_backwards else OPEN.switch_off())


def test_what_is_switched_off_keeps_its_sections_and_loses_its_setpoints() -> None:
    deep = ImplementCommand(sections_on=(True, False), setpoints={"depth_m": 0.02})
    assert deep.switch_off() == ImplementCommand(sections_on=(False, False))


def test_limits_slow_the_robot_along_the_same_curve() -> None:
    gate = Gate(SafetyConfig(max_speed_mps=0.5, max_yaw_rate_radps=0.3))
    for _ in range(100):
        sent, reason = gate.send(DriveCommand(v_mps=0.8, yaw_rate_radps=0.6))
    assert reason == YawRateLimited(0.6, 0.3)
    assert sent.drive.yaw_rate_radps == pytest.approx(0.3)
    assert sent.drive.v_mps == pytest.approx(0.4)
    for _ in range(100):
        sent, reason = gate.send(DriveCommand(v_mps=-0.8))
    assert sent.drive.v_mps == pytest.approx(-0.5)
    assert reason == SpeedLimited(0.8, 0.5)


@pytest.mark.parametrize(
    "drive",
    [DriveCommand(v_mps=0.5001), DriveCommand(v_mps=-0.504), DriveCommand(yaw_rate_radps=0.3001)],
)
def test_what_is_over_a_limit_by_less_than_is_shown_is_limited_without_a_word(
    drive: DriveCommand,
) -> None:
    gate = Gate(SafetyConfig(max_speed_mps=0.5, max_yaw_rate_radps=0.3))
    for _ in range(100):
        sent, reason = gate.send(drive)
        assert reason is None
        assert gate.supervisor.gate.state == "driving"
    assert abs(sent.drive.v_mps) <= 0.5
    assert abs(sent.drive.yaw_rate_radps) <= 0.3


@pytest.mark.parametrize("sensor", ["wheels", "imu"])
def test_a_sensor_that_falls_silent_stops_the_robot_until_a_person_clears_it(
    sensor: Unspoken,
) -> None:
    gate = Gate().cruise()
    stopped_after_s = None
    for tick in range(1, 30):
        silent = msgspec.structs.replace(gate.rover.batch(), t_s=gate.rover.t_s + TICK_S)
        silent = msgspec.structs.replace(silent, **{sensor: ()})
        sent, reason = gate.send(batch=silent)
        if sent.drive == STOP:
            stopped_after_s = tick * TICK_S
            break
    assert stopped_after_s == pytest.approx(0.3, abs=0.021)
    assert holds(reason, SensorSilent(sensor, 0.3, 0.3, ANY), within=0.021)
    for _ in range(100):  # it speaks again
        assert_stopped(*gate.send(), StopToClear, SensorSilent(sensor, ANY, 0.3, ANY))
    sent, reason = gate.send(actions=("clear_stop",))
    assert reason is None
    assert 0.0 < sent.drive.v_mps < FORWARD.v_mps


@pytest.mark.parametrize("sensor", ["wheels", "imu"])
def test_a_sensor_that_never_spoke_is_a_fault_from_the_first_tick(sensor: Unspoken) -> None:
    gate = Gate()
    batch = msgspec.structs.replace(gate.rover.batch(), **{sensor: ()})
    assert_stopped(*gate.send(batch=batch), NotHeardYet(sensor))
    assert gate.send()[1] is None, "nothing was stopped, so there is no stop to clear"


def tilted_batch(gate: Gate, accel_mps2: tuple[float, float, float]) -> SensorBatch:
    batch = msgspec.structs.replace(gate.rover.batch(), t_s=gate.rover.t_s + TICK_S)
    imu = msgspec.structs.replace(batch.imu[0], t_s=batch.t_s, accel_mps2=accel_mps2)
    return msgspec.structs.replace(batch, imu=(imu,))


def test_a_tilt_that_the_imu_does_not_measure_is_told_and_is_not_level() -> None:
    gate = Gate().cruise()
    batch = msgspec.structs.replace(gate.rover.batch(), t_s=gate.rover.t_s + TICK_S)
    imu = msgspec.structs.replace(batch.imu[0], t_s=batch.t_s, accel_mps2=None)
    sent, reason = gate.send(batch=msgspec.structs.replace(batch, imu=(imu,)))
    assert (sent.drive == STOP, reason) == (False, None)
    assert gate.supervisor.gate.warning_fact == TiltUnknown()
    gate.send(batch=tilted_batch(gate, (0.0, 0.0, 9.8)))
    assert gate.supervisor.gate.warning_fact is None


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_robot_that_tips_over_is_stopped(axis: int, side: float) -> None:
    gate = Gate().cruise()
    accel = [0.0, 0.0, 9.8 * math.cos(0.9)]
    accel[axis] = side * 9.8 * math.sin(0.9)
    for _ in range(100):
        sent, reason = gate.send(batch=tilted_batch(gate, (accel[0], accel[1], accel[2])))
    assert_stopped(sent, reason, StopToClear, Tilted(ANY, 0.6))


def test_lying_on_the_roof_is_a_tilt_too() -> None:
    gate = Gate().cruise()
    for _ in range(200):
        sent, reason = gate.send(batch=tilted_batch(gate, (0.0, 0.0, -9.8)))
    assert_stopped(sent, reason, Tilted)


def test_a_single_knock_is_not_a_tilt() -> None:
    gate = Gate().cruise()
    sent, reason = gate.send(batch=tilted_batch(gate, (15.0, 0.0, 9.8)))
    assert (sent.drive, reason) == (FORWARD, None)


def test_an_imu_that_reports_no_number_stops_the_robot_until_a_person_clears_it() -> None:
    gate = Gate().cruise()
    assert_stopped(
        *gate.send(batch=tilted_batch(gate, (math.nan, 0.0, 9.8))), SensorNotFinite("imu")
    )
    assert_stopped(*gate.send(), StopToClear(SensorNotFinite("imu")))
    assert gate.send(actions=("clear_stop",))[1] is None


def test_a_stop_of_the_operator_holds_until_it_is_cleared() -> None:
    gate = Gate().cruise()
    assert_stopped(*gate.send(actions=("stop",)), StoppedBy("operator"))
    assert_stopped(*gate.send(actions=("resume",)), StoppedBy("operator"))
    assert_stopped(*gate.send(), StopToClear)
    assert gate.send(actions=("clear_stop",))[1] is None


@pytest.mark.parametrize("state", ["waiting", "done", "cancelled", "failed"])
def test_nothing_moves_unless_the_mission_runs(state: MissionState) -> None:
    assert_stopped(*Gate().cruise().send(state=state), MissionIdle(state, Said("why")))


def test_a_pause_may_ramp_down_but_never_hold_speed() -> None:
    gate = Gate().cruise()
    speeds = [gate.send(state="paused")[0].drive.v_mps for _ in range(60)]
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[0] < FORWARD.v_mps
    assert speeds[-1] == 0.0
    sent, _ = gate.send(state="paused")
    assert sent.implement.sections_on == (False, False, False)


def test_after_a_stop_the_robot_gains_speed_no_faster_than_the_drive() -> None:
    gate = Gate().cruise()
    gate.send(estimate=gate.believed(ok=False))
    speeds = [gate.send()[0].drive.v_mps for _ in range(20)]
    steps = np.diff([0.0, *speeds])
    assert steps.max() <= ROBOT.drive.max_accel_mps2 * TICK_S * 1.001
    assert speeds[-1] == FORWARD.v_mps


def test_an_open_nozzle_over_a_standing_robot_is_closed() -> None:
    gate = Gate().cruise()
    sent, reason = gate.send(DriveCommand(yaw_rate_radps=0.2))
    assert sent.implement.sections_on == (False, False, False)
    assert reason is None


def test_a_stop_that_was_wanted_anyway_needs_no_reason() -> None:
    gate = Gate()
    batch = gate.rover.batch()
    command = RobotCommand(t_s=0.0)
    unready = gate.believed(ok=False)
    sent, reason = gate.supervisor.check(command, unready, batch, goal("waiting"))
    assert (sent.drive, reason) == (STOP, None)


def test_fence_of_a_path_is_its_box_and_a_margin() -> None:
    path = Path(
        xy_map_m=np.array([[0.0, 1.0], [4.0, -2.0]]), yaw_map_rad=np.zeros(2),
        curvature_radpm=np.zeros(2), row=np.zeros(2, dtype=np.int64), s_m=np.array([0.0, 5.0]),
    )  # fmt: skip
    fence = PathFence.around(path, 3.0)
    assert fence == PathFence(-3.0, -5.0, 7.0, 4.0)
    assert fence.holds(7.0, 4.0)
    assert not fence.holds(7.1, 0.0)
    assert not fence.holds(math.nan, 0.0)


anything = st.floats(allow_nan=True, allow_infinity=True, width=64)
moderate = st.floats(-3.0, 3.0)


@settings(max_examples=300, deadline=None)
@given(
    twists=st.lists(st.tuples(moderate | anything, moderate | anything), min_size=1, max_size=12),
    x_m=moderate | anything,
    pos_std_m=moderate | anything,
    accel=st.tuples(anything, moderate, st.just(9.8)),
    state=st.sampled_from(["running", "paused", "waiting", "failed"]),
    ok=st.booleans(),
)
def test_output_is_finite_and_never_faster_than_what_was_asked_for(
    twists: list[tuple[float, float]],
    x_m: float,
    pos_std_m: float,
    accel: tuple[float, float, float],
    state: MissionState,
    ok: bool,
) -> None:
    gate, config = Gate(), SafetyConfig()
    for v_mps, yaw_rate_radps in twists:
        wanted = DriveCommand(v_mps=v_mps, yaw_rate_radps=yaw_rate_radps)
        estimate = gate.believed(x_map_m=x_m, pos_std_m=pos_std_m, ok=ok)
        sent, reason = gate.send(
            wanted, estimate=estimate, batch=tilted_batch(gate, accel), state=state
        )
        drive = sent.drive
        assert math.isfinite(drive.v_mps)
        assert math.isfinite(drive.yaw_rate_radps)
        assert abs(drive.v_mps) <= min(_size(v_mps), config.max_speed_mps)
        assert abs(drive.yaw_rate_radps) <= min(_size(yaw_rate_radps), config.max_yaw_rate_radps)
        assert drive.v_mps * (v_mps if math.isfinite(v_mps) else 0.0) >= 0.0
        assert all(a <= b for a, b in zip(sent.implement.sections_on, (1, 0, 1), strict=True))
        if not ok and (v_mps, yaw_rate_radps) != (0.0, 0.0):
            assert drive == STOP
            assert reason


def _size(value: float) -> float:
    return math.inf if math.isnan(value) else abs(value)
