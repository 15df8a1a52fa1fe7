"""The table of hazards, the states of the gate, and the list before the start."""

from __future__ import annotations

from typing import get_args
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest

from agribot.autonomy.control.camera_watch import CameraWatch
from agribot.autonomy.control.gate_machine import STATES
from agribot.autonomy.control.hazards import CHECKS, HAZARDS, LIDAR, OF_BOARD
from agribot.core.config import SafetyConfig
from agribot.core.facts import (
    CameraLate,
    CameraSilent,
    DrivenByHand,
    Fact,
    FarFromMap,
    ImuLineSpoilt,
    ImuSpoilt,
    LeavesBox,
    LeavesField,
    MissionIdle,
    MissionSetsOff,
    MotorsReportFault,
    NetworkSilent,
    NoFixesYet,
    NoPosition,
    Over,
    PictureUnfit,
    Runaway,
    Said,
    StopCleared,
    StopToClear,
    TooDark,
    Wheel,
    WheelsWrong,
)
from agribot.core.field_bounds import FieldBounds
from agribot.core.messages import (
    STOP,
    CameraFrame,
    DriveCommand,
    Estimate,
    GateState,
    HandDrive,
    ImuSample,
    Scene,
    SensorBatch,
    Who,
)
from agribot.sim.faults.table import find_kind
from tests.autonomy.control.kinematic_rover import TICK_S
from tests.autonomy.control.test_protective_stops import faulty, touching
from tests.autonomy.control.test_supervisor import FORWARD, Gate, assert_stopped, goal
from tests.finding import holds, is_like

AHEAD = DriveCommand(v_mps=0.4)
CHECKS_OF_A_BARE_ROBOT = tuple(name for name in CHECKS if name not in ("camera", LIDAR, *OF_BOARD))
NO_PIXELS = np.zeros((0, 0, 3), np.uint8)


def test_every_hazard_has_a_name_of_its_own_and_faults_and_settings_that_exist() -> None:
    names = [hazard.name for hazard in HAZARDS]
    assert len(set(names)) == len(names)
    known = {*SafetyConfig.__struct_fields__}
    for hazard in HAZARDS:
        for fault in hazard.faults:
            find_kind(fault)
        for part in hazard.limit.split("`safety.")[1:]:
            assert part.partition("`")[0] in known, hazard.name
        is_accepted = hazard.for_hand == "until cleared"
        assert bool(hazard.kind) is is_accepted, "what is accepted has a kind"


def test_what_moves_although_it_must_not_is_told_by_what_latches() -> None:
    latching = {
        fault for hazard in HAZARDS if hazard.reaction == "latch" for fault in hazard.faults
    }
    for fault in ("bumper.contact", "board.silent", "motor.dead", "soil.mud", "imu.bias"):
        assert fault in latching


def spoilt(gate: Gate, **changes: tuple[float, float, float]) -> SensorBatch:
    t_s = gate.rover.t_s + TICK_S
    sample = ImuSample(t_s=t_s, gyro_radps=(0.0, 0.0, 0.2), accel_mps2=(0.0, 0.0, 9.8))
    sample = msgspec.structs.replace(sample, **changes)
    return msgspec.structs.replace(gate.rover.batch(), t_s=t_s, imu=(sample,))


@pytest.mark.parametrize(
    ("changes", "value"),
    [({"accel_mps2": (0.0, 1e200, 9.8)}, 1e200), ({"gyro_radps": (-3e7, 0.0, 0.2)}, 3e7)],
)
def test_one_spoilt_number_of_the_imu_is_told_and_no_tilt(
    changes: dict[str, tuple[float, float, float]], value: float
) -> None:
    gate = Gate().cruise()
    sent, reason = gate.send(batch=spoilt(gate, **changes))
    assert (sent.drive, reason) == (FORWARD, None)
    fact = gate.supervisor.gate.warning_fact
    assert fact == ImuSpoilt(value)
    assert fact.parts == ("imu", "link")  # the sensor, or what carries its numbers
    for _ in range(300):
        sent, reason = gate.send()
    assert (sent.drive, reason) == (FORWARD, None)
    assert not holds(gate.supervisor.gate.warning_fact, Fact)


def test_a_line_that_spoils_numbers_again_and_again_is_no_line_to_drive_with() -> None:
    gate = Gate().cruise()
    for _ in range(3):
        assert gate.send()[1] is None
        for _ in range(30):
            gate.send()
        sent, reason = gate.send(batch=spoilt(gate, accel_mps2=(0.0, 1e200, 9.8)))
    assert_stopped(sent, reason, StopToClear(ImuLineSpoilt(3, ANY, ANY)))


def states_of(gate: Gate) -> tuple[str, Fact | None]:
    return gate.supervisor.gate.state, gate.supervisor.gate.fact


def test_the_gate_tells_its_state_and_why_at_every_turn() -> None:
    gate = Gate()
    gate.send(STOP, state="waiting")
    assert states_of(gate) == ("standby", MissionIdle("waiting", Said("why")))
    gate.cruise()
    assert states_of(gate) == ("driving", MissionSetsOff())
    gate.send(estimate=gate.lost_estimate())
    assert states_of(gate) == ("held", NoPosition(Said("no GNSS fix")))
    gate.send()
    assert states_of(gate) == ("driving", Over(NoPosition(Said("no GNSS fix"))))
    gate.send(DriveCommand(v_mps=3.0))
    assert states_of(gate)[0] == "slowed"
    gate.send(batch=touching(gate, 0.5))
    assert states_of(gate)[0] == "stopped"
    gate.send(STOP, state="paused", actions=("clear_stop",))
    cleared = StopCleared("operator", MissionIdle("paused", Said("why")))
    assert states_of(gate) == ("standby", cleared)
    hand = HandDrive(t_s=gate.rover.t_s, v_mps=-0.2, yaw_rate_radps=0.0, who=Who("Ann"))
    batch = msgspec.structs.replace(gate.rover.batch(), t_s=gate.rover.t_s + TICK_S, hand=(hand,))
    gate.send(DriveCommand(v_mps=-0.2), batch=batch, state="paused", is_by_hand=True)
    assert states_of(gate) == ("by hand", DrivenByHand("Ann"))
    for _ in range(30):  # until nothing is touched any more
        gate.send(DriveCommand(v_mps=-0.2), state="paused", is_by_hand=True)
    gate.send()
    assert states_of(gate)[0] == "driving"


def test_every_state_of_the_gate_is_in_its_table() -> None:
    assert {row.state for row in STATES} == set(get_args(GateState))


def test_before_the_first_motion_every_item_is_checked_and_told_once() -> None:
    gate = Gate()
    gate.send(STOP, state="waiting")
    assert not gate.supervisor.gate.checks
    gate.send()
    checks = gate.supervisor.gate.checks
    assert tuple(check.name for check in checks) == CHECKS_OF_A_BARE_ROBOT
    assert {"clock", "wheels and IMU", "battery", "bumper", "position", "heading", "field",
            "tool"} <= set(CHECKS)  # fmt: skip
    assert all(check.is_ok for check in checks)
    gate.send()
    assert not gate.supervisor.gate.checks, "once"


@pytest.mark.parametrize(
    ("item", "changes"),
    [
        ("position", {"ok": False, "fact": NoFixesYet()}),
        ("position", {"t_s": -5.0}),
        ("heading", {"yaw_std_rad": 0.7}),
        ("field", {"x_map_m": 9.0}),
    ],
)
def test_an_item_that_is_not_good_holds_the_start_with_its_reason(
    item: str, changes: dict[str, object]
) -> None:
    gate = Gate()
    bad = gate.believed(**changes)
    sent, reason = gate.send(estimate=bad)
    assert_stopped(sent, reason)
    status = gate.supervisor.gate
    assert status.state == "checking"
    assert reason is not None and status.fact == reason
    assert [check.name for check in status.checks if not check.is_ok] == [item]
    gate.send(estimate=bad)
    assert not gate.supervisor.gate.checks, "reported once"
    gate.send()
    status = gate.supervisor.gate
    assert status.state == "driving"
    assert all(check.is_ok for check in status.checks)
    gate.send(estimate=bad)
    assert states_of(gate)[0] == "held", "under way it is no start any more"


def test_a_mission_that_waits_for_long_has_its_list_published_with_what_it_waits_for() -> None:
    """The refusal of a receiver far from the map stood in the mission's reason alone."""
    gate = Gate()
    far = FarFromMap(52.1, 11.6, 6.8e6, 0.0, 0.0, 1e5)
    bad = gate.believed(ok=False, fact=NoFixesYet())
    published = []
    for tick in range(round(12.0 / TICK_S)):
        if tick == round(8.0 / TICK_S):
            bad = gate.believed(ok=False, fact=far)
        gate.send(STOP, estimate=bad, state="waiting")
        if gate.supervisor.gate.checks:
            published.append((tick * TICK_S, gate.supervisor.gate.checks))
    assert [t_s for t_s, _ in published] == pytest.approx([5.0, 8.0], abs=0.1)
    assert states_of(gate)[0] == "standby"
    wrong = {check.name: check.fact for check in published[-1][1] if not check.is_ok}
    assert wrong["position"] == NoPosition(far)
    gate.send()
    assert all(check.is_ok for check in gate.supervisor.gate.checks)


def test_a_mission_after_the_end_of_one_is_checked_anew() -> None:
    gate = Gate().cruise()
    gate.send(STOP, state="done")
    gate.send()
    assert len(gate.supervisor.gate.checks) == len(CHECKS_OF_A_BARE_ROBOT)
    gate.send(STOP, state="paused")
    gate.send()
    assert not gate.supervisor.gate.checks, "a pause is no end"


def test_a_motor_at_fault_is_an_item_of_the_list() -> None:
    gate = Gate()
    dead = ("left_wheel_F",)
    assert_stopped(*gate.send(batch=faulty(gate, dead)), MotorsReportFault(dead))
    assert states_of(gate)[0] == "stopped"


SQUARE = FieldBounds(
    rings_map_m=(np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 20.0], [0.0, 20.0]]),),
    front_m=0.4, rear_m=0.4, half_width_m=0.5,
)  # fmt: skip


def at(x_m: float) -> Estimate:
    return msgspec.structs.replace(Gate().rover.estimate(), x_map_m=x_m, y_map_m=10.0)


def by_hand(gate: Gate, estimate: Estimate) -> tuple[DriveCommand, Fact | None]:
    bounded = msgspec.structs.replace(goal("paused"), bounds=SQUARE, path=None)
    gate.rover.t_s += TICK_S
    sent, reason = gate.supervisor.check(
        gate.command(AHEAD), estimate, gate.rover.batch(), bounded, is_by_hand=True
    )
    gate.rover.turn_wheels(sent.drive)
    return sent.drive, reason


def test_a_hand_that_takes_the_robot_out_of_the_field_is_stopped_once_and_then_may() -> None:
    gate = Gate()
    for _ in range(5):
        assert by_hand(gate, at(10.0))[1] is None
    drive, reason = by_hand(gate, at(19.6))
    assert drive == STOP
    assert holds(reason, LeavesField(19.6, 10.0, is_by_hand=True))
    gate.send(STOP, state="paused", actions=("clear_stop",))
    drive, reason = by_hand(gate, at(19.6))
    assert drive.v_mps > 0.0
    assert reason is None
    assert by_hand(Gate(), at(25.0))[1] is None, "outside it may be brought back"
    lost = msgspec.structs.replace(at(19.6), pos_std_m=9.0)
    assert by_hand(Gate(), lost)[1] is None, "who does not know the place says nothing of it"


def test_the_box_around_the_path_counts_with_the_way_of_braking() -> None:
    gate = Gate(SafetyConfig(geofence_margin_m=5.0)).cruise()
    near = gate.believed(x_map_m=4.95)
    assert_stopped(*gate.send(AHEAD, estimate=near), LeavesBox(4.95, ANY, is_inside=True))
    back = gate.send(DriveCommand(v_mps=-0.4), estimate=near)
    assert back[1] is None


class Pictures:
    """A picture and what is seen in it, ten times a second."""

    def __init__(self) -> None:
        self.watch, self._ticks = CameraWatch(SafetyConfig()), 0

    def go(self, seconds: float, fault: str = "") -> Fact | None:
        for _ in range(round(seconds * 10)):
            self._ticks += 1
            t_s = self._ticks / 10.0
            late_s = 2.0 if fault == "late" else 0.1
            frame = CameraFrame(t_s=t_s - late_s, index=0, image_rgb=NO_PIXELS)
            scene = Scene(t_s=t_s, ready_s=t_s, frame_index=0, plants=(), view_body_m=())
            frames = () if fault == "off" else (frame,)
            scenes = () if fault in ("off", "hung") else (scene,)
            self.watch.update(SensorBatch(t_s=t_s, frames=frames), scenes)
        return self.watch.fault


@pytest.mark.parametrize(
    ("fault", "wanted"),
    [
        ("off", CameraSilent(ANY, ANY)),
        ("late", CameraLate(2.0, ANY)),
        ("hung", NetworkSilent(ANY, ANY)),
    ],
)
def test_a_camera_or_a_network_that_fails_is_named_and_the_tool_goes_off(
    fault: str, wanted: Fact
) -> None:
    pictures = Pictures()
    assert pictures.go(3.0) is None
    assert is_like(pictures.go(1.5, fault), wanted, within=0.05)
    assert pictures.go(0.5) is None
    gate = Gate().cruise()
    for tick in range(150):
        scene = Scene(t_s=gate.rover.t_s, ready_s=gate.rover.t_s, frame_index=0, plants=(),
                      view_body_m=())  # fmt: skip
        gate.rover.t_s += TICK_S
        batch, scenes = gate.rover.batch(), (scene,) if tick < 50 else ()
        sent, reason = gate.supervisor.check(
            gate.command(FORWARD), gate.rover.estimate(), batch, goal("running"), scenes
        )
        gate.rover.turn_wheels(sent.drive)
    assert (sent.drive, reason) == (FORWARD, None), "it drives on"
    assert not sent.implement.is_on
    assert isinstance(gate.supervisor.gate.warning_fact, NetworkSilent)


def test_the_tool_is_off_while_the_plants_that_the_camera_names_are_in_doubt() -> None:
    gate = Gate().cruise()
    for doubt, is_on in ((None, True), (PictureUnfit(cause=TooDark()), False), (None, True)):
        for _ in range(3):
            gate.rover.t_s += TICK_S
            estimate = gate.believed(plants_fact=doubt)
            sent, reason = gate.supervisor.check(
                gate.command(FORWARD), estimate, gate.rover.batch(), goal("running")
            )
            gate.rover.turn_wheels(sent.drive)
        assert (sent.drive, reason) == (FORWARD, None), "it drives on"
        assert sent.implement.is_on == is_on


def test_a_robot_without_a_camera_or_with_a_slow_one_lacks_nothing() -> None:
    watch = CameraWatch(SafetyConfig())
    for tick in range(1000):
        watch.update(SensorBatch(t_s=tick * TICK_S), ())
        assert watch.fault is None
    slow = CameraWatch(SafetyConfig())
    for tick in range(2000):
        t_s = tick * TICK_S
        frame = CameraFrame(t_s=t_s, index=0, image_rgb=NO_PIXELS)
        slow.update(SensorBatch(t_s=t_s, frames=(frame,) if tick % 125 == 0 else ()), ())
        assert slow.fault is None or t_s < 3.0, "a picture every 2.5 s"


def test_a_board_that_runs_away_is_told_with_the_red_button() -> None:
    gate = Gate().cruise()
    for _ in range(100):
        gate.rover.turn_wheels(DriveCommand(v_mps=1.0))
        sent, reason = gate.send()
    assert sent.drive == STOP
    by_button = Runaway(ANY, is_cut=False, is_contactor_stuck=False)
    assert is_like(reason, by_button)
    assert holds(reason, WheelsWrong(get_args(Wheel), "fast", ANY, ANY))
