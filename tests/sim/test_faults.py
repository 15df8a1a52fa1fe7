"""Injected faults: each changes what it says, while it lasts, and nothing else."""

from __future__ import annotations

import itertools
import math
import re
from typing import Any

import msgspec
import numpy as np
import pytest

from agribot.core.config import PerceptionConfig, RunConfig, SimConfig
from agribot.core.errors import ConfigError
from agribot.core.facts import BoardHung
from agribot.core.geo import MapFrame
from agribot.core.messages import (
    WHEEL_NAMES,
    CameraFrame,
    ClearStop,
    DriveCommand,
    FloatArray,
    GnssQuality,
    PlantClass,
    RobotCommand,
    Scene,
    SensorBatch,
)
from agribot.core.robot import RobotSpec
from agribot.core.world import Plant, WorldSpec
from agribot.sim.faults.layer import FaultLayer
from agribot.sim.faults.links import flip_bit
from agribot.sim.faults.motions import MOTOR_T_PER_NM
from agribot.sim.faults.pictures import HungNetwork, find_mount_shift_m
from agribot.sim.faults.schedule import parse_fault, read_faults
from agribot.sim.faults.table import FAULTS, Span
from agribot.sim.platform import SimPlatform

FROM_S, UNTIL_S, END_S = 2.0, 4.0, 5.0
WHILE = f"@{FROM_S:g}+{UNTIL_S - FROM_S:g}"
# What stands between sensors and batch, and the fields of the batch that it changes.
OF_SAMPLES = {
    "gnss.outage": ("gnss", "headings"),
    "gnss.jump=2": ("gnss",),
    "gnss.wrong_fix=0.5": ("gnss",),
    "gnss.drift=0.1": ("gnss",),
    "gnss.frozen": ("gnss", "headings"),
    "gnss.scatter=5": ("gnss",),
    "gnss.velocity=10": ("gnss",),
    "mag.motor": ("mag",),
    "mag.offset=20": ("mag",),
    "imu.bias=0.1": ("imu",),
    "imu.frozen": ("imu",),
    "imu.unplugged": ("imu", "mag"),
    "wheels.stuck=left_wheel_F": ("wheels",),
    "wheels.reversed": ("wheels",),
    "bumper.contact": ("bumper",),
    "battery.empty": ("battery",),
    "link.noise=1": ("wheels", "imu", "mag", "gnss", "headings", "battery"),
}
BEND = DriveCommand(v_mps=0.4, yaw_rate_radps=0.2)
FIELDS = ("wheels", "imu", "mag", "gnss", "headings", "bumper", "battery")


class Drive:
    """A drive of the bare rover under one command, and all that it sent."""

    def __init__(
        self, rover: RobotSpec, world: WorldSpec, *faults: str, seed: int = 1,
        drive: DriveCommand = BEND,
        sensors: str = "rtk-dual", end_s: float = END_S,
    ) -> None:  # fmt: skip
        config = RunConfig(
            seed=seed, faults=faults, sim=SimConfig(sensors=sensors),
            perception=PerceptionConfig(enabled=False),
        )  # fmt: skip
        self.platform = SimPlatform(config, rover, world)
        self.frame = MapFrame(world.datum)
        self.batches: list[SensorBatch] = []
        self.truth = [self.platform.truth()]
        while self.platform.truth().t_s < end_s - 1e-6:
            self.batches.append(self.platform.read())
            self.truth.append(self.platform.truth())
            self.platform.write(RobotCommand(t_s=self.batches[-1].t_s, drive=drive))

    def list(self, field: str, from_s: float = 0.0, until_s: float = math.inf) -> list[Any]:
        samples = [sample for batch in self.batches for sample in getattr(batch, field)]
        return [s for s in samples if from_s - 1e-9 <= s.t_s < until_s - 1e-9]

    def places_m(self, from_s: float, until_s: float) -> np.ndarray[Any, Any]:
        fixes = self.list("gnss", from_s, until_s)
        return np.array(
            [self.frame.map_from_geodetic(f.lat_deg, f.lon_deg, f.alt_m) for f in fixes]
        )

    def true_at(self, t_s: float) -> Any:
        return min(self.truth, key=lambda truth: abs(truth.t_s - t_s))


@pytest.fixture(scope="module")
def good(rover: RobotSpec, meadow: WorldSpec) -> Drive:
    return Drive(rover, meadow)


def off_m(bad: Drive, good: Drive, from_s: float = FROM_S, until_s: float = UNTIL_S) -> Any:
    return (bad.places_m(from_s, until_s) - good.places_m(from_s, until_s))[:, :2]


@pytest.mark.parametrize("name", OF_SAMPLES)
def test_a_fault_of_a_sensor_changes_that_sensor_while_it_lasts_and_nothing_else(
    name: str, rover: RobotSpec, meadow: WorldSpec, good: Drive
) -> None:
    bad = Drive(rover, meadow, f"{name}{WHILE}")
    for field in FIELDS:
        assert bad.list(field, 0.0, FROM_S) == good.list(field, 0.0, FROM_S), field
        now = bad.list(field, FROM_S, UNTIL_S), good.list(field, FROM_S, UNTIL_S)
        assert (now[0] == now[1]) == (field not in OF_SAMPLES[name]), field
        after = bad.list(field, UNTIL_S), good.list(field, UNTIL_S)
        if field != "wheels" or "wheels." not in name:  # what was not counted stays lost
            assert after[0] == after[1], field
    assert bad.truth == good.truth  # these sensors are not used here


def test_the_same_seed_gives_the_same_faults_and_another_seed_others(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    faults = (f"gnss.jump=2{WHILE}", f"link.noise=0.3{WHILE}", f"mag.offset=20{WHILE}")
    runs = [Drive(rover, meadow, *faults, seed=seed) for seed in (1, 1, 2)]
    assert repr(runs[0].batches) == repr(runs[1].batches)  # nan is not equal to itself
    first, _, other = (run.places_m(FROM_S, UNTIL_S)[:3, :2].mean(0) for run in runs)
    assert np.hypot(*(first - other)) > 0.1


def test_one_fault_more_changes_nothing_of_the_first(rover: RobotSpec, meadow: WorldSpec) -> None:
    alone = Drive(rover, meadow, f"gnss.jump=2{WHILE}")
    both = Drive(rover, meadow, f"imu.bias=0.1{WHILE}", f"gnss.jump=2{WHILE}")
    assert alone.list("gnss") == both.list("gnss")


def test_positions_jump_drift_and_lie(rover: RobotSpec, meadow: WorldSpec, good: Drive) -> None:
    since_s = np.array([fix.t_s - FROM_S for fix in good.list("gnss", FROM_S, UNTIL_S)])
    jumped = off_m(Drive(rover, meadow, "gnss.jump=2@2~1+2"), good)  # it rises for a second
    assert np.hypot(*jumped.T) == pytest.approx(np.minimum(2.0 * since_s, 2.0), abs=1e-3)
    assert np.ptp(jumped[since_s >= 1.0], axis=0) == pytest.approx(0.0, abs=1e-3)
    drifted = off_m(Drive(rover, meadow, f"gnss.drift=0.1{WHILE}"), good)
    assert np.hypot(*drifted.T) == pytest.approx(0.1 * since_s, abs=1e-3)
    lying = Drive(rover, meadow, f"gnss.wrong_fix=0.5{WHILE}", sensors="m8n")
    fixes = lying.list("gnss", FROM_S, UNTIL_S)
    assert {fix.quality for fix in fixes} == {GnssQuality.RTK_FIXED}
    assert max(fix.pos_std_m for fix in fixes) < 0.02
    assert {fix.quality for fix in lying.list("gnss", UNTIL_S)} == {GnssQuality.SINGLE}
    assert np.hypot(*off_m(lying, Drive(rover, meadow, sensors="m8n")).T) == pytest.approx(
        0.5, abs=1e-3
    )


def test_a_frozen_receiver_repeats_all_but_the_time(rover: RobotSpec, meadow: WorldSpec) -> None:
    frozen = Drive(rover, meadow, f"gnss.frozen{WHILE}")
    last = frozen.list("gnss", 0.0, FROM_S)[-1]
    held = frozen.list("gnss", FROM_S, UNTIL_S)
    assert len(held) >= 19
    assert [msgspec.structs.replace(fix, t_s=last.t_s) for fix in held] == [last] * len(held)
    assert all(b.t_s > a.t_s for a, b in itertools.pairwise(held))


def test_velocity_noise_is_so_many_times_what_the_receiver_says(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    straight = DriveCommand(v_mps=0.4)
    runs = [
        Drive(rover, meadow, *faults, drive=straight, end_s=22.0)
        for faults in ((), ("gnss.velocity=10@2",))
    ]
    fixes = [run.list("gnss", 2.0) for run in runs]
    noise = [
        np.array([b.velocity_mps for b in fixes[1]]) - np.array([a.velocity_mps for a in fixes[0]])
    ]
    stated_mps = fixes[1][0].velocity_std_mps
    assert stated_mps == fixes[0][0].velocity_std_mps
    assert np.std(noise) == pytest.approx(10.0 * stated_mps, rel=0.1)  # 600 numbers


def test_positions_scatter_by_so_many_times_what_the_receiver_says(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    runs = [Drive(rover, meadow, *faults, end_s=22.0) for faults in ((), ("gnss.scatter=5@2",))]
    good, bad = (run.list("gnss", 2.0) for run in runs)
    frame = MapFrame(meadow.datum)
    off_m = [
        np.array(frame.map_from_geodetic(b.lat_deg, b.lon_deg, b.alt_m))
        - frame.map_from_geodetic(a.lat_deg, a.lon_deg, a.alt_m)
        for a, b in zip(good, bad, strict=True)
    ]
    assert np.array([fix.pos_std_m for fix in bad]) == pytest.approx(
        np.array([fix.pos_std_m for fix in good])
    )
    stated_m = good[0].pos_std_m
    # What is added to the receiver's own scatter, of 400 numbers.
    assert np.std(np.array(off_m)[:, :2]) == pytest.approx(math.sqrt(24.0) * stated_m, rel=0.1)


def test_the_magnetometer_feels_motors_and_magnets(
    rover: RobotSpec, meadow: WorldSpec, good: Drive
) -> None:
    def field_t(drive: Drive) -> np.ndarray[Any, Any]:
        return np.array([sample.field_t for sample in drive.list("mag", FROM_S, UNTIL_S)])

    magnet = field_t(Drive(rover, meadow, f"mag.offset=20{WHILE}")) - field_t(good)
    assert np.hypot(magnet[:, 0], magnet[:, 1]) == pytest.approx(20e-6)
    assert magnet[:, 2] == pytest.approx(0.0, abs=1e-12)
    motors = np.linalg.norm(field_t(Drive(rover, meadow, f"mag.motor{WHILE}")) - field_t(good),
                            axis=1)  # fmt: skip
    loads_nm = [
        sum(map(abs, good.list("wheels", 0.0, sample.t_s + 1e-6)[-1].effort_nm))
        for sample in good.list("mag", FROM_S, UNTIL_S)
    ]
    assert motors == pytest.approx(MOTOR_T_PER_NM * np.array(loads_nm), rel=0.2)


def test_an_imu_is_biased_frozen_or_late(rover: RobotSpec, meadow: WorldSpec, good: Drive) -> None:
    def rates(drive: Drive) -> np.ndarray[Any, Any]:
        return np.array([sample.gyro_radps for sample in drive.list("imu", FROM_S, UNTIL_S)])

    biased = rates(Drive(rover, meadow, f"imu.bias=-0.1{WHILE}")) - rates(good)
    assert biased == pytest.approx(np.tile((0.0, 0.0, -0.1), (len(biased), 1)))
    assert np.ptp(rates(Drive(rover, meadow, f"imu.frozen{WHILE}")), axis=0).max() == 0.0
    late = Drive(rover, meadow, f"imu.late=0.25{WHILE}")
    assert late.list("imu") == good.list("imu")  # none is lost, and all stamps are true
    for batch in late.batches:
        for sample in batch.imu:
            if FROM_S <= sample.t_s < UNTIL_S - 0.3:
                assert 0.25 - 1e-9 <= batch.t_s - sample.t_s < 0.275
            elif sample.t_s < FROM_S or sample.t_s >= UNTIL_S + 0.02:
                assert batch.t_s - sample.t_s < 0.021


def test_encoders_stick_or_count_backwards_and_lose_what_they_missed(
    rover: RobotSpec, meadow: WorldSpec, good: Drive
) -> None:
    stuck = Drive(rover, meadow, f"wheels.stuck={WHEEL_NAMES[3]}{WHILE}")
    for sample, true in zip(
        stuck.list("wheels", FROM_S, UNTIL_S), good.list("wheels", FROM_S, UNTIL_S), strict=True
    ):
        assert sample.speed_radps == (*true.speed_radps[:3], 0.0)
        assert sample.angle_rad[:3] == true.angle_rad[:3]
    assert len({s.angle_rad[3] for s in stuck.list("wheels", FROM_S, UNTIL_S)}) == 1
    back = Drive(rover, meadow, f"wheels.reversed{WHILE}")
    for sample, true in zip(back.list("wheels"), good.list("wheels"), strict=True):
        sign = -1.0 if FROM_S - 1e-9 <= sample.t_s < UNTIL_S - 1e-9 else 1.0
        assert sample.speed_radps == tuple(sign * v for v in true.speed_radps)
    angle = [s.angle_rad[0] for s in back.list("wheels", FROM_S, UNTIL_S)]
    assert angle[-1] < angle[0] - 1.0
    assert back.list("wheels")[-1].angle_rad[0] < good.list("wheels")[-1].angle_rad[0] - 2.0


def test_the_clock_steps_for_all_stamps_at_once(
    rover: RobotSpec, meadow: WorldSpec, good: Drive
) -> None:
    stepped = Drive(rover, meadow, f"clock.step=-3{WHILE}")
    for bad, true in zip(stepped.batches, good.batches, strict=True):
        by_s = -3.0 if FROM_S - 1e-9 <= true.t_s < UNTIL_S - 1e-9 else 0.0
        assert bad.t_s == true.t_s + by_s
        for a, b in zip(bad.wheels + bad.imu, true.wheels + true.imu, strict=True):
            is_on = FROM_S - 1e-9 <= b.t_s < UNTIL_S - 1e-9
            assert a.t_s == b.t_s - 3.0 * is_on
    assert stepped.truth == good.truth


def test_a_noisy_link_loses_and_spoils_the_share_that_it_says(
    rover: RobotSpec, meadow: WorldSpec, good: Drive
) -> None:
    noisy = Drive(rover, meadow, "link.noise=0.2@0")
    sent = {sample.t_s: sample for sample in good.list("imu")}
    heard = noisy.list("imu")
    lost_ratio = 1.0 - len(heard) / len(sent)
    spoilt_ratio = sum(repr(s) != repr(sent[s.t_s]) for s in heard) / len(sent)
    assert lost_ratio == pytest.approx(0.1, abs=0.03)  # 3 sigma of 1000 samples
    assert spoilt_ratio == pytest.approx(0.1, abs=0.03)
    assert flip_bit(1.0, 63) == -1.0
    assert flip_bit(flip_bit(0.1, 17), 17) == 0.1
    assert flip_bit(1.0, 62) == math.inf  # absurd is what a false bit of the exponent is


def test_a_battery_falls_to_five_percent_and_comes_back(
    rover: RobotSpec, meadow: WorldSpec, good: Drive
) -> None:
    empty = Drive(rover, meadow, f"battery.empty{WHILE}")
    low, full = empty.list("battery", FROM_S, UNTIL_S), good.list("battery", FROM_S, UNTIL_S)
    assert [sample.charge_ratio for sample in low] == pytest.approx([0.05] * len(low))
    assert all(a.voltage_v < b.voltage_v - 6.0 for a, b in zip(low, full, strict=True))


def test_a_silent_board_sends_nothing_and_hears_nothing(
    rover: RobotSpec, meadow: WorldSpec, good: Drive
) -> None:
    silent = Drive(rover, meadow, f"board.silent{WHILE}")
    assert silent.list("wheels", FROM_S, UNTIL_S) == []
    assert silent.list("imu", FROM_S, UNTIL_S)
    timeout_s = rover.drive.command_timeout_s
    assert silent.true_at(FROM_S + timeout_s / 2.0).v_mps == pytest.approx(0.4, abs=0.05)
    assert silent.true_at(UNTIL_S - 0.1).v_mps == pytest.approx(0.0, abs=0.01)
    assert silent.true_at(END_S).v_mps == pytest.approx(0.4, abs=0.05)


def test_the_red_button_stops_the_motors_for_as_long_as_it_is_pressed(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    pressed = Drive(rover, meadow, f"button.pressed{WHILE}")
    for sample in pressed.list("board"):
        is_on = FROM_S - 1e-9 <= sample.t_s < UNTIL_S - 1e-9
        assert sample.is_button_pressed == is_on
        assert sample.inputs == ("red button",)
    assert len(pressed.list("board")) == len(pressed.batches)
    assert pressed.true_at(FROM_S).v_mps == pytest.approx(0.4, abs=0.05)
    # Its first contact carries the current of the contactor: without power no motor brakes.
    assert 0.1 < pressed.true_at(FROM_S + 0.5).v_mps < 0.35
    assert pressed.true_at(UNTIL_S).v_mps == pytest.approx(0.0, abs=0.02)
    assert pressed.true_at(END_S).v_mps == pytest.approx(0.4, abs=0.05)


@pytest.mark.parametrize("name", ["button.pressed", "inputs.silent"])
def test_a_device_that_fails_twice_fails_each_time(
    rover: RobotSpec, meadow: WorldSpec, name: str
) -> None:
    faults = [parse_fault(f"{name}@{begin_s}+1") for begin_s in (1, 3)]
    layer = FaultLayer(faults, RunConfig(), rover, meadow)
    told = [layer.alter(SensorBatch(t_s=t_s)).board[-1] for t_s in (0.5, 1.5, 2.5, 3.5, 4.5)]
    fails = [one.is_button_pressed or not one.inputs for one in told]
    assert fails == [False, True, False, True, False]


def test_a_board_that_hung_stands_and_tells_why_until_a_person_clears_its_stop(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    config = RunConfig(
        faults=("board.hung@2",), perception=PerceptionConfig(enabled=False)
    )  # fmt: skip
    platform = SimPlatform(config, rover, meadow)
    speeds_mps, told, heard = {}, {}, []
    for tick in range(1, 301):
        batch = platform.read()
        if tick == 200:
            platform.inbox.post(ClearStop())
        speeds_mps[tick] = platform.truth().v_mps
        told[tick] = batch.board[-1] if batch.board else None
        if not batch.wheels:
            heard.append(batch.t_s)
        platform.write(RobotCommand(t_s=batch.t_s, drive=DriveCommand(v_mps=0.4)))
    assert speeds_mps[100] == pytest.approx(0.4, abs=0.05) and told[99] is None
    assert 2.0 <= heard[0] <= heard[-1] <= 2.25
    assert max(abs(speeds_mps[tick]) for tick in range(140, 200)) < 0.01
    silent = told[150]
    assert silent is not None and silent.fault == BoardHung() and silent.stop
    last = told[201]
    assert last is not None and not last.stop and not last.fault
    assert speeds_mps[300] == pytest.approx(0.4, abs=0.05)


def test_motors_die_weaken_and_recover(rover: RobotSpec, meadow: WorldSpec) -> None:
    turn = DriveCommand(yaw_rate_radps=1.0)  # skidding needs torque at every wheel
    dead = Drive(rover, meadow, f"motor.dead={WHEEL_NAMES[3]}{WHILE}", drive=turn)
    efforts_nm = np.array([s.effort_nm for s in dead.list("wheels", FROM_S + 0.1, UNTIL_S)])
    assert np.abs(efforts_nm[:, 3]).max() == 0.0
    assert np.abs(efforts_nm[:, :3]).mean(0).min() > 0.2
    assert abs(dead.list("wheels")[-1].effort_nm[3]) > 0.2
    weak = [Drive(rover, meadow, f"motor.weak=0.01{WHILE}", drive=turn, seed=seed)
            for seed in (1, 2, 3, 4)]  # fmt: skip
    limit_nm = 0.01 * rover.drive.wheel_torque_nm
    limited = set()
    for drive in weak:
        most_nm = np.abs([s.effort_nm for s in drive.list("wheels", FROM_S + 0.1, UNTIL_S)]).max(0)
        assert np.count_nonzero(most_nm <= limit_nm * 1.001) == 1
        limited.add(int(np.argmin(most_nm)))
    assert len(limited) > 1  # the seed draws the wheel


def test_a_board_runs_away_whatever_it_is_told(rover: RobotSpec, meadow: WorldSpec) -> None:
    runaway = Drive(rover, meadow, f"motor.runaway{WHILE}", drive=DriveCommand())
    assert runaway.true_at(FROM_S).v_mps == pytest.approx(0.0, abs=1e-3)
    assert runaway.true_at(UNTIL_S).v_mps == pytest.approx(rover.drive.max_speed_mps, rel=0.05)
    assert runaway.true_at(END_S).v_mps == pytest.approx(0.0, abs=0.01)


def test_in_mud_the_wheels_spin_and_the_robot_hardly_gains_speed(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    def gain_mps(*faults: str) -> float:
        fast = DriveCommand(v_mps=1.0)
        drive = Drive(rover, meadow, *faults, drive=fast, end_s=1.0)
        return float(drive.true_at(0.9).v_mps)

    firm, mud = gain_mps(), gain_mps("soil.mud=0.03@0")
    # Coulomb: no more acceleration than the friction times gravity.
    assert mud < 0.03 * 9.8 * 0.9 * 1.1 < 0.4 * firm


def test_mud_fills_a_hollow_beyond_which_the_ground_is_firm(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    drive = Drive(rover, meadow, "soil.mud=0.01@0", drive=DriveCommand(v_mps=1.0), end_s=9.0)
    start_m = drive.truth[0].x_map_m
    way_m = [truth.x_map_m - start_m for truth in drive.truth]
    deep, out = (drive.truth[int(np.searchsorted(way_m, place_m))] for place_m in (1.9, 2.4))
    # Coulomb in the hollow: v^2 = 2 a s, with no more than friction times gravity.
    assert deep.v_mps < 1.1 * math.sqrt(2.0 * 0.01 * 9.8 * 1.9)
    assert out.v_mps > deep.v_mps + 0.2


def test_a_robot_is_lifted_carried_to_its_left_and_set_down(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    moved = Drive(rover, meadow, "carried=-0.6@2", drive=DriveCommand())
    yaw_rad = moved.truth[0].yaw_map_rad
    left = np.array([-math.sin(yaw_rad), math.cos(yaw_rad)])

    def place(t_s: float) -> np.ndarray[Any, Any]:
        truth = moved.true_at(t_s)
        return np.array([truth.x_map_m, truth.y_map_m])

    assert place(2.0) == pytest.approx(place(0.0), abs=1e-3)
    assert place(2.6) - place(2.0) == pytest.approx(-0.3 * left, abs=0.02)  # half of 1.2 s
    assert place(5.0) - place(2.0) == pytest.approx(-0.6 * left, abs=1e-2)
    up_mps2 = [sample.accel_mps2[2] for sample in moved.list("imu", 2.0, 3.2)]
    assert max(up_mps2) > 11.0  # it feels the lift, and never falls
    assert 3.0 < min(up_mps2) < 8.0
    assert np.mean(up_mps2) == pytest.approx(9.81, abs=0.3)
    turns = np.array([sample.gyro_radps for sample in moved.list("imu", 2.0, 3.2)])
    assert np.abs(turns).max() < 0.2
    assert moved.truth[-1].roll_rad == pytest.approx(moved.truth[0].roll_rad, abs=0.01)


def test_hands_carry_a_robot_over_the_crop_and_crush_only_where_they_set_it_down(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    start = np.array(meadow.spawn_xy_map_m)
    yaw_rad = meadow.spawn_yaw_map_rad
    ahead = np.array([math.cos(yaw_rad), math.sin(yaw_rad)])
    left = np.array([-ahead[1], ahead[0]])
    wheel_m = rover.wheel_xy_body_m()[3]  # front left
    aside_m = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    plants = tuple(
        Plant(species="sugar_beet", plant=PlantClass.CROP, x_map_m=x_m, y_map_m=y_m, yaw_rad=0.0,
              size_m=0.02, seed=1, stem_radius_m=0.005)
        for x_m, y_m in (
            (start + wheel_m[0] * ahead + (wheel_m[1] + off_m) * left).tolist()
            for off_m in aside_m
        )
    )  # fmt: skip
    field = msgspec.structs.replace(meadow, plants=plants)
    moved = Drive(rover, field, "carried=0.6@2", drive=DriveCommand())
    assert moved.platform.crushed == {5}
    moved = Drive(rover, field, "carried=0.8@2", drive=DriveCommand())
    assert moved.platform.crushed == set()


def test_a_robot_is_put_down_beside_its_start_and_turned(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    there = Drive(rover, meadow, end_s=0.1).truth[0]
    beside = Drive(rover, meadow, "start.aside=0.5@0", "start.turned=-30@0", end_s=0.1).truth[0]
    assert beside.yaw_map_rad - there.yaw_map_rad == pytest.approx(math.radians(-30.0), abs=1e-3)
    assert beside.x_map_m - there.x_map_m == pytest.approx(-0.5 * math.sin(there.yaw_map_rad),
                                                           abs=1e-3)  # fmt: skip
    assert beside.y_map_m - there.y_map_m == pytest.approx(0.5 * math.cos(there.yaw_map_rad),
                                                           abs=1e-3)  # fmt: skip


def test_a_pole_that_no_map_knows_stands_in_the_way(rover: RobotSpec, meadow: WorldSpec) -> None:
    hit = Drive(rover, meadow, "obstacle.unmapped@2", drive=DriveCommand(v_mps=0.5), end_s=9.0)
    touch = hit.list("bumper")[0]
    way_m = 2.0 - 0.05 - touch.x_body_m  # to the pole's skin
    assert touch.t_s == pytest.approx(2.0 + way_m / 0.5, abs=0.3)
    assert abs(hit.truth[-1].v_mps) < 0.1
    assert hit.list("bumper", 0.0, 2.5) == []


def test_camera_faults_change_pixels_or_times_and_a_pole_is_seen(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    def frames(*faults: str) -> list[tuple[float, CameraFrame]]:
        config = RunConfig(seed=1, faults=faults, sim=SimConfig(camera_noise=False),
                           perception=PerceptionConfig(camera_rate_hz=5.0))  # fmt: skip
        platform, found = SimPlatform(config, rover, meadow), []
        for _ in range(70):
            batch = platform.read()
            platform.write(RobotCommand(t_s=batch.t_s, drive=DriveCommand(v_mps=0.5)))
            found += [(batch.t_s, frame) for frame in batch.frames]
        return found

    good = frames()
    for name, change in (
        ("black", np.zeros_like),
        ("flipped", lambda image: image[::-1, ::-1]),
        ("mirrored", lambda image: image[:, ::-1]),
        ("frozen", lambda _: good[1][1].image_rgb),
    ):
        bad = frames(f"camera.{name}@0.5+0.5")
        assert [frame.t_s for _, frame in bad] == [frame.t_s for _, frame in good]
        for (_, frame), (_, true) in zip(bad, good, strict=True):
            is_on = 0.5 <= true.t_s < 1.0
            wanted = change(true.image_rgb) if is_on else true.image_rgb
            assert np.array_equal(frame.image_rgb, wanted), (name, true.t_s)
    assert [f.t_s for _, f in frames("camera.off@0.5+0.5")] == [
        f.t_s for _, f in good if not 0.5 <= f.t_s < 1.0
    ]
    late = frames("camera.late=0.3@0.5")
    assert all(t_s - f.t_s == pytest.approx(0.3, abs=0.021) for t_s, f in late if f.t_s >= 0.5)
    pole = frames("obstacle.unmapped@0.5")
    assert np.array_equal(pole[1][1].image_rgb, good[1][1].image_rgb)
    assert not np.array_equal(pole[-1][1].image_rgb, good[-1][1].image_rgb)


def test_a_camera_that_is_knocked_aside_sees_what_a_robot_that_stands_there_sees(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    def look(*faults: str) -> FloatArray:
        config = RunConfig(seed=1, faults=faults, sim=SimConfig(camera_noise=False))
        platform = SimPlatform(config, rover, meadow)
        frames = [frame for _ in range(50) for frame in platform.read().frames]
        return frames[-1].image_rgb.astype(np.float64)

    beside = look("start.aside=0.3@0")
    shifted = look("camera.shifted=0.3@0.2")
    assert np.abs(shifted - beside).mean() < 0.1 * np.abs(look() - beside).mean()
    shifts = [parse_fault(text) for text in ("camera.shifted=-0.2@2+1", "camera.creeping=0.1@2+2")]
    shifts_m = [find_mount_shift_m(shifts, t_s) for t_s in (1.0, 2.5, 3.5, 4.5)]
    assert shifts_m == pytest.approx([0.0, -0.15, 0.15, 0.0])


def test_a_hung_network_is_not_asked_while_frames_still_come() -> None:
    class Looking:
        meter = None

        def __init__(self) -> None:
            self.seen: list[int] = []

        def step(self, batch: SensorBatch) -> tuple[Scene, ...]:
            self.seen += [frame.index for frame in batch.frames]
            return ()

        def settle(self) -> None: ...
        def close(self) -> None: ...

    looking, now = Looking(), [0.0]
    hung = HungNetwork(looking, [parse_fault("network.hung@2+2")], lambda: now[0])
    for index in range(6):
        now[0] = float(index)
        frame = CameraFrame(t_s=now[0], index=index, image_rgb=np.zeros((1, 1, 3), np.uint8))
        assert hung.step(SensorBatch(t_s=now[0], frames=(frame,))) == ()
    assert looking.seen == [0, 1, 4, 5]


def test_a_run_that_goes_on_has_its_faults_on_its_own_clock() -> None:
    config = RunConfig(
        faults=("gnss.outage@10+20", "imu.frozen@3+2", "carried=1@5", "mag.motor@40"),
        duration_s=20.0,
    )
    moved = read_faults(config, began_s=25.0)
    assert [(f.name, f.begin_s, f.end_s) for f in moved] == [
        ("gnss.outage", -15.0, 5.0),
        ("mag.motor", 15.0, math.inf),
    ]


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("gnss.jump=2@10~20+50", (0.0, 1.0, 2.0)),
        ("gnss.scatter=5@10~20", (1.0, 3.0, 5.0)),  # of one sigma on
        ("motor.weak=0.2@10~20", (1.0, 0.6, 0.2)),
        ("imu.bias=-0.4@10~20", (0.0, -0.2, -0.4)),
        ("gnss.jump=2@10", (2.0, 2.0, 2.0)),
    ],
)
def test_a_value_rises_from_what_is_harmless(text: str, numbers: tuple[float, ...]) -> None:
    fault = parse_fault(text)
    assert [fault.find_number(t_s) for t_s in (10.0, 20.0, 40.0)] == pytest.approx(numbers)


def test_every_fault_says_what_it_is_and_its_typical_value_can_be_given() -> None:
    assert len({kind.name for kind in FAULTS}) == len(FAULTS) == 46
    for kind in FAULTS:
        assert kind.about and kind.accepted
        value = f"={kind.typical}" if kind.value is not None else ""
        fault = parse_fault(f"{kind.name}{value}@0")
        assert fault.kind is kind
        if isinstance(kind.value, Span):
            assert fault.number == float(kind.typical)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("gnss.jmp=2@30", "unknown fault 'gnss.jmp'; did you mean 'gnss.jump'?; known: gnss."),
        ("gnss.jump@30", "gnss.jump lacks its value, 0.01 to 1e+06 m; such as gnss.jump=2"),
        ("gnss.jump=2", "lacks a time"),
        ("gnss.jump=0@3", "out of range"),
        ("gnss.jump=nan@3", "out of range"),
        ("imu.bias=-11@3", "out of range"),
        ("gnss.frozen=1@3", "takes no value"),
        ("gnss.frozen@-3", "no mission has the time -3 s"),
        ("gnss.frozen@inf", "no time in seconds"),
        ("gnss.frozen@1e6", "no mission has the time"),
        ("gnss.frozen@3+0", "lasts 0 s"),
        ("gnss.frozen@3+nan", "no time in seconds"),
        ("carried=1@3+2", "leave out +2"),
        ("gnss.frozen@3~2", "has no value that can rise; leave out ~2"),
        ("gnss.jump=2@3~0", "it rises in 0 s"),
        ("motor.dead=left@3", "no wheel 'left'"),
        ("start.aside=1@4", "write it with @0"),
        ("gnss.frozen@60", "it never comes, the run ends after 60 s"),
        ("camera.black@3", "perception.enabled is false"),
        ("network.hung@3", "perception.enabled is false"),
    ],
)  # fmt: skip
def test_a_fault_that_cannot_be_is_refused(text: str, said: str) -> None:
    config = RunConfig(faults=(text,), duration_s=60.0, perception=PerceptionConfig(enabled=False))
    with pytest.raises(ConfigError, match=re.escape(said)):
        read_faults(config)


def test_faults_need_the_simulator_and_what_they_act_on() -> None:
    elsewhere = RunConfig(faults=("gnss.frozen@3",), platform="my_robot:open_platform")
    with pytest.raises(ConfigError, match="faults are those of the simulator"):
        read_faults(elsewhere)
    with pytest.raises(ConfigError, match="has no camera"):
        read_faults(RunConfig(faults=("camera.off@3",)), has_camera=False)
