"""Wheels on soil: power and slip on slopes, turning, shaking on rough ground.

Everything is measured on the packaged robot, the turning also on two with the geometry and mass of
Clearpath's Husky and Jackal, whose `wheel_separation_multiplier` was found on the machines.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec
import numpy as np

from agribot.core.geo import Datum
from agribot.core.messages import WHEEL_NAMES, DriveCommand, FloatArray
from agribot.core.robot import Joint, Link, RobotSpec
from agribot.core.world import HeightField, Relief, SoilClass, SoilStrength, WorldSpec

STEP_NS, TICK_S = 2_000_000, 0.02
SPEED_MPS, DRIVE_S, STEADY_S = 0.4, 5.0, 2.0
ALONG, ACROSS = 0.0, math.pi / 2
SLOPES = {
    "0": (0.0, ALONG), "5_along": (5.0, ALONG), "5_across": (5.0, ACROSS),
    "10_along": (10.0, ALONG), "10_across": (10.0, ACROSS),
    "15_along": (15.0, ALONG), "15_across": (15.0, ACROSS),
}  # fmt: skip
TRACTION = 0.4
ROUGH = Relief(
    seed=1, roughness_rms_m=0.014, clods_per_m2=25.0, clod_height_m=0.04
)  # the relief of a tilled field
SHAKEN_S, TURN_S = 20.0, 4.0
YAW_RATE_RADPS = 0.6
REPEATS = 5


class Machine(NamedTuple):
    """A four-wheel skid-steer robot as its maker publishes it."""

    multiplier: float
    wheelbase_m: float
    track_m: float
    radius_m: float
    width_m: float
    mass_kg: float


MACHINES = {
    "husky": Machine(1.875, 0.5120, 0.5708, 0.1651, 0.1143, 46.0),
    "jackal": Machine(1.5, 0.2620, 0.37559, 0.098, 0.040, 17.0),
}


class Drive(NamedTuple):
    """The steady part of a drive; `rows` are those of the history."""

    rows: FloatArray
    net_w: float
    gross_w: float
    drawn_w: float
    slip_ratio: float
    crab_rad: float
    yaw_rate_radps: float


def measure(
    soil_class: SoilClass, moisture_ratio: float, show_line: Callable[[str], None]
) -> dict[str, Any]:
    """Measure all slopes; `show_line` gets a line for each."""
    from agribot.description.loader import load_robot

    robot, strength = (
        load_robot(),
        SoilStrength(soil_class=soil_class, moisture_ratio=moisture_ratio),
    )
    powers, drives = {}, {}
    show_line(f"{soil_class} soil, moisture {moisture_ratio:g}, {SPEED_MPS} m/s")
    show_line("slope      power  battery   slip   crab   gross/net")
    for name, (degrees, yaw_rad) in SLOPES.items():
        drive = drives[name] = drive_slope(robot, strength, degrees, yaw_rad)
        powers[name] = drive.gross_w / abs(drive.net_w)
        show_line(
            f"{name:9} {drive.net_w:5.2f} W {drive.drawn_w:6.1f} W {100 * drive.slip_ratio:5.1f} % "
            f"{math.degrees(drive.crab_rad):5.2f}° {powers[name]:7.3f}"
        )
    pulling = drive_slope(robot, strength, math.degrees(math.atan(TRACTION)), ALONG)
    roll_deg, pitch_deg = measure_shaking_deg(robot, strength)
    result = {
        "soil_class": soil_class,
        "moisture_ratio": moisture_ratio,
        "power_ratio": powers,
        "slip_at_traction_0.4": pulling.slip_ratio,
        "side_slip_deg_15": math.degrees(drives["15_across"].crab_rad),
        "separation_ratio": {
            name: measure_separation_ratio(make_machine(robot, machine), strength)
            for name, machine in MACHINES.items()
        },
        "roll_rms_deg": roll_deg,
        "pitch_rms_deg": pitch_deg,
        "physics_rtf_cpu": measure_rtf(robot, strength),
    }
    for name in ("slip_at_traction_0.4", "side_slip_deg_15", "separation_ratio", "roll_rms_deg",
                 "pitch_rms_deg", "physics_rtf_cpu"):  # fmt: skip
        show_line(f"{name}: {result[name]}")
    return result


def make_ground(strength: SoilStrength, degrees: float = 0.0, yaw_rad: float = 0.0) -> WorldSpec:
    """Make a plane that rises towards East, with the robot on it."""
    world = WorldSpec(
        name="ground", datum=Datum(lat_deg=0.0, lon_deg=0.0), strength=strength,
        spawn_yaw_map_rad=yaw_rad,
    )  # fmt: skip
    if not degrees:
        return world
    edge_m = np.array([-8.0, 8.0])
    height_m = np.tile(math.tan(math.radians(degrees)) * edge_m, (2, 1))
    field = HeightField(height_m=height_m, x_min_m=-8.0, y_min_m=-8.0, resolution_m=16.0)
    return msgspec.structs.replace(world, terrain=field)


def make_machine(robot: RobotSpec, machine: Machine) -> RobotSpec:
    """Make a robot of a machine's geometry and mass from another one."""
    mass = machine.mass_kg / robot.mass_kg
    size = machine.radius_m / robot.drive.wheel_radius_m
    drive = msgspec.structs.replace(
        robot.drive, wheel_radius_m=machine.radius_m, wheel_width_m=machine.width_m,
        track_m=machine.track_m, wheelbase_m=machine.wheelbase_m,
        yaw_multiplier=machine.multiplier, torque_nm=robot.drive.torque_nm * mass * size,
        rotor_inertia_kgm2=robot.drive.rotor_inertia_kgm2 * mass * size**2,
        servo_gain_nmspr=robot.drive.servo_gain_nmspr * mass * size**2,
        torque_constant_nmpa=robot.drive.torque_constant_nmpa * size,
        winding_ohm=robot.drive.winding_ohm / mass, no_load_a=robot.drive.no_load_a * mass,
    )  # fmt: skip
    tyre = msgspec.structs.replace(
        robot.tyre, normal_stiffness_npm=robot.tyre.normal_stiffness_npm * mass,
        bristle_stiffness_npm=robot.tyre.bristle_stiffness_npm * mass,
        relaxation_length_m=robot.tyre.relaxation_length_m * math.sqrt(size),
    )  # fmt: skip
    return msgspec.structs.replace(
        robot,
        drive=drive,
        tyre=tyre,
        links=tuple(_scale_link(link, mass, size) for link in robot.links),
        joints=tuple(_move_wheel(joint, robot, machine) for joint in robot.joints),
    )


def _scale_link(link: Link, mass: float, size: float) -> Link:
    inertia = tuple(value * mass * size**2 for value in link.inertia_kgm2)
    return msgspec.structs.replace(link, mass_kg=link.mass_kg * mass, inertia_kgm2=inertia)


def _move_wheel(joint: Joint, robot: RobotSpec, machine: Machine) -> Joint:
    if joint.child not in WHEEL_NAMES:
        return joint
    x_m, y_m, z_m = joint.origin.xyz_m
    place = (
        x_m * machine.wheelbase_m / robot.drive.wheelbase_m,
        y_m * machine.track_m / robot.drive.track_m,
        z_m + machine.radius_m - robot.drive.wheel_radius_m,
    )
    return msgspec.structs.replace(joint, origin=msgspec.structs.replace(joint.origin, xyz_m=place))


def drive_slope(robot: RobotSpec, strength: SoilStrength, degrees: float, yaw_rad: float) -> Drive:
    """Drive straight up a slope, or along it, and measure the steady part."""
    return drive_world(robot, make_ground(strength, degrees, yaw_rad), SPEED_MPS, 0.0, DRIVE_S)


def drive_world(
    robot: RobotSpec, world: WorldSpec, v_mps: float, yaw_rate_radps: float, drive_s: float
) -> Drive:
    """Drive with one command and measure the last STEADY_S."""
    from agribot.sim.physics import Physics
    from agribot.sim.state import ANGULAR, DRAWN, EFFORT, WHEEL_SPEED

    physics = Physics(robot, world, STEP_NS)
    rows = _advance(physics, v_mps, yaw_rate_radps, drive_s)[-round(STEADY_S * 1e9 / STEP_NS) :]
    power_w = rows[:, EFFORT] * rows[:, WHEEL_SPEED]
    ahead_mps, left_mps = _compute_body_speeds_mps(rows)
    load_n = robot.mass_kg * world.gravity_mps2 / 4.0
    rolling_m = robot.drive.wheel_radius_m - load_n / robot.tyre.normal_stiffness_npm
    rolled_mps = float(rows[:, WHEEL_SPEED].mean()) * rolling_m
    return Drive(
        rows,
        net_w=float(power_w.sum(axis=1).mean()),
        gross_w=float(np.abs(power_w).sum(axis=1).mean()),
        drawn_w=float(np.ptp(rows[:, DRAWN])) / (STEADY_S - STEP_NS / 1e9),
        slip_ratio=1.0 - ahead_mps / rolled_mps if rolled_mps else 0.0,
        crab_rad=math.atan2(left_mps, ahead_mps),
        yaw_rate_radps=float(rows[:, ANGULAR][:, 2].mean()),
    )


def _advance(physics: Any, v_mps: float, yaw_rate_radps: float, drive_s: float) -> FloatArray:
    rows = []
    for _ in range(round(drive_s / TICK_S)):
        physics.command(DriveCommand(v_mps=v_mps, yaw_rate_radps=yaw_rate_radps))
        rows.append(physics.advance(round(TICK_S * 1e9 / STEP_NS))[1:].copy())
    return np.concatenate(rows)


def _compute_body_speeds_mps(rows: FloatArray) -> tuple[float, float]:
    """Return the mean speeds of base_link forward and to its left, along its own axes."""
    from agribot.sim.state import QUATERNION, VELOCITY

    w, x, y, z = rows[:, QUATERNION].T
    vx, vy, vz = rows[:, VELOCITY].T
    ahead = vx * (1 - 2 * (y * y + z * z)) + vy * 2 * (x * y + w * z) + vz * 2 * (x * z - w * y)
    left = vx * 2 * (x * y - w * z) + vy * (1 - 2 * (x * x + z * z)) + vz * 2 * (y * z + w * x)
    return float(ahead.mean()), float(left.mean())


def measure_separation_ratio(robot: RobotSpec, strength: SoilStrength) -> float:
    """Measure the effective over the true track, in a turn on the spot."""
    from agribot.sim.state import WHEEL_SPEED

    drive = drive_world(robot, make_ground(strength), 0.0, YAW_RATE_RADPS, TURN_S)
    right = [name.startswith("right") for name in WHEEL_NAMES]
    sides = np.where(right, 0.5, -0.5)
    rim_mps = robot.drive.wheel_radius_m * float((drive.rows[:, WHEEL_SPEED] @ sides).mean())
    return rim_mps / drive.yaw_rate_radps / robot.drive.track_m


def measure_shaking_deg(robot: RobotSpec, strength: SoilStrength) -> tuple[float, float]:
    """Measure the RMS of roll and pitch on rough ground at SPEED_MPS."""
    from agribot.sim.attitude import read_roll_pitch_yaw
    from agribot.sim.physics import Physics

    world = msgspec.structs.replace(make_ground(strength), relief=ROUGH)
    rows = _advance(Physics(robot, world, STEP_NS), SPEED_MPS, 0.0, SHAKEN_S)
    angles = np.degrees([read_roll_pitch_yaw(row)[:2] for row in rows[::10]])
    roll_deg, pitch_deg = np.sqrt((angles**2).mean(axis=0)).tolist()
    return roll_deg, pitch_deg


def measure_rtf(robot: RobotSpec, strength: SoilStrength) -> float:
    """Measure simulated seconds per CPU second in steps of 2 ms, the best of some."""
    from agribot.sim.physics import Physics

    physics, spent = Physics(robot, make_ground(strength), STEP_NS), []
    for _ in range(REPEATS):
        physics.command(DriveCommand(v_mps=SPEED_MPS, yaw_rate_radps=0.2))
        started_s = time.process_time()
        physics.advance(500)
        spent.append(time.process_time() - started_s)
    return 1.0 / min(spent)
