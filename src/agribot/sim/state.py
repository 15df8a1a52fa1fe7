"""Data of the physics kernel: MuJoCo's arrays, the motor board and the state history."""

from __future__ import annotations

from typing import NamedTuple

from agribot.core.messages import FloatArray

# Columns of the history: the state after each physics step.
POSITION = slice(0, 3)  # position of base_link in the map
QUATERNION = slice(3, 7)  # map_from_base, w first
VELOCITY = slice(7, 10)  # velocity of base_link in the map
ANGULAR = slice(10, 13)  # angular rate in base axes
VELOCITY_GAIN = slice(13, 16)  # integral of the specific force at the IMU, base axes, m/s
ANGLE_GAIN = slice(16, 19)  # integral of the angular rate, base axes, rad
WHEEL_ANGLE = slice(19, 23)
WHEEL_SPEED = slice(23, 27)
TORQUE = slice(27, 28)  # sum of the magnitudes over the four motors, Nm
EFFORT = slice(28, 32)  # torque of each motor as it arrives at the wheel, Nm
TARGET = slice(32, 36)  # wheel speeds that the board wants
FAULT = slice(36, 40)  # 1 where a wheel does not follow the command to its motor
WORK = slice(40, 41)  # sum of |torque * speed| of the motors since the start, J
DRAWN = slice(41, 42)  # energy from the battery by the motors since the start, J
HISTORY_COLUMNS = 42  # columns for a robot with four wheels
# Behind them angle, speed, effort, target and fault of the wheels between the corners, each for
# all of these wheels.
MIDDLE_COLUMNS = 5
MOST_WHEELS = 8


def count_columns(wheels: int) -> int:
    """Count the columns of the history of a robot with `wheels` wheels."""
    return HISTORY_COLUMNS + MIDDLE_COLUMNS * (wheels - 4)


class StateViews(NamedTuple):
    """Arrays of mjData, shared with MuJoCo."""

    qpos: FloatArray
    qvel: FloatArray
    ctrl: FloatArray
    actuator_force: FloatArray
    xpos: FloatArray
    xipos: FloatArray
    xmat: FloatArray
    cvel: FloatArray
    subtree_com: FloatArray
    xfrc_applied: FloatArray


class Board(NamedTuple):
    """The motor board: ramps of the twist, assumed geometry of the drive, wheel control.

    The gains are those of each wheel's controller. With `is_effort` its torque goes to the wheel
    unchanged; else `p_nmspr` is also the gain of MuJoCo's servo, whose torque follows the speed.
    """

    max_accel_mps2: float
    max_yaw_accel_radps2: float
    wheel_radius_m: float
    half_separation_m: float
    is_effort: bool
    p_nmspr: float
    i_nmprad: float
    d_nms2prad: float
    torque_nm: float


class Motor(NamedTuple):
    """A motor, its gear and its controller, as felt at the wheel."""

    torque_constant_nmpa: float
    resistance_ohm: float
    no_load_a: float
    gear_efficiency_ratio: float
    controller_efficiency_ratio: float
    regeneration_ratio: float


class Inertial(NamedTuple):
    """Place of the IMU in base axes, and gravity."""

    x_m: float
    y_m: float
    z_m: float
    gravity_mps2: float
