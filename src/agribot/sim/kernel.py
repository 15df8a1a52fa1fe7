"""The inner loop: motor board, MuJoCo and tyres, without Python between the steps.

All of it stays in one file: numba's disk cache notices a change of the file that a function
stands in, but not of the files of the functions that it calls.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.core.messages import FloatArray, Vec3
from agribot.sim.jit import compile_exact
from agribot.sim.mujoco_library import Library, call
from agribot.sim.soil import SoilLaw
from agribot.sim.state import HISTORY_COLUMNS, MOST_WHEELS, Board, Inertial, Motor, StateViews
from agribot.sim.tyre import Terrain, TyreLaw

# Spin below which the rolling resistance fades out, so that a parked wheel is not driven by it.
ROLLING_FADE_RADPS = 0.2
TINY = 1e-9
# Yield of tread and crumbs under the highest point of a tyre's support.
ENVELOPE_SOFTNESS_M = 0.005
# Speeds over ground below which the resistance of soil fades out, and a standing wheel sinks in.
COMPACTION_FADE_MPS = 0.02
SINKING_S = 0.05
MOST_SLIP = 0.5  # largest slip in the law of slip sinkage; beyond, assumed, it digs no deeper
MOST_SHEAR = 4.0  # times K: more displacement changes nothing
# Cells behind the hub at which a rut is pressed, beyond what the wheel itself stands on.
RUT_BEHIND, RUT_HALF, RUT_EVERY = 3.2, 0.75, 0.25
RUT_WALL_SLOPE = 0.7  # slope of loose soil, 35 degrees
# On soil a wheel stands on a plane through four places of its tread: shares of radius and width.
TREAD_AHEAD, TREAD_ASIDE = 0.25, 0.25

# Columns of a wheel's state on soil: sinkage below the ground, what of it springs back, and the way
# since a rut was pressed, m.
SINK, BACK, WAY = range(3)
SOIL_STATES = 3

# Entries of the motor board's state.
BOARD_V, BOARD_YAW_RATE, BOARD_TARGET_V, BOARD_TARGET_YAW_RATE, BOARD_TIME_LEFT = range(5)
# Then MOST_WHEELS of each, in the order of the wheels.
BOARD_TARGET, BOARD_INTEGRAL, BOARD_SPEED, BOARD_FAULT_TIME = 5, 13, 21, 29
BOARD_SIZE = 37
BOARD_HOLD = slice(BOARD_INTEGRAL, BOARD_INTEGRAL + MOST_WHEELS)

# Time for which a wheel at fault hardly turns or gets hardly any torque when it should.
FAULT_AFTER_S = 0.5
FAULT_RATIO = 0.1
FAULT_MIN_RADPS = 0.5


class SoilContact(NamedTuple):
    """A wheel on soil: friction and rut below it, its arm, and speeds of its contact."""

    grip: float
    rut_m: float
    arm_m: float
    slip_mps: Vec3  # forward, to the left and up
    rolling_mps: float


@compile_exact
def sample_grid(grid: Terrain, x_m: float, y_m: float) -> tuple[float, float, float]:
    """Return the value and its slopes along x and y; the edge's value continues outside."""
    values, step_m = grid.values, grid.resolution_m
    column = min(max((x_m - grid.x_min_m) / step_m, 0.0), values.shape[1] - 1.000001)
    row = min(max((y_m - grid.y_min_m) / step_m, 0.0), values.shape[0] - 1.000001)
    i, j = int(column), int(row)
    u, v = column - i, row - j
    h00, h10, h01, h11 = values[j, i], values[j, i + 1], values[j + 1, i], values[j + 1, i + 1]
    lower, upper = h00 + (h10 - h00) * u, h01 + (h11 - h01) * u
    slope_x = ((h10 - h00) * (1.0 - v) + (h11 - h01) * v) / step_m
    return lower + (upper - lower) * v, slope_x, (upper - lower) / step_m


@compile_exact
def _cross(a: Vec3, b: Vec3) -> Vec3:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compile_exact
def _dot(a: Vec3, b: Vec3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compile_exact
def _scale(a: Vec3, scale: float) -> Vec3:
    return a[0] * scale, a[1] * scale, a[2] * scale


@compile_exact
def _add(a: Vec3, b: Vec3) -> Vec3:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compile_exact
def sample_envelope(
    terrain: Terrain, envelope: FloatArray, x_m: float, y_m: float, ahead_x: float, ahead_y: float
) -> tuple[float, float, float]:
    """Return the height, and its slopes along x and y, of what a tyre rests on at a place.

    `ahead` is the level unit vector in which the wheel points. It is the highest under the tread
    points `envelope` (n, 3), softly: log of the mean exponential. On even ground it is the ground.
    """
    below, slope_x, slope_y = sample_grid(terrain, x_m, y_m)
    if envelope.shape[0] == 1:
        return below, slope_x, slope_y
    total, flat, slope_x, slope_y = 0.0, 0.0, 0.0, 0.0
    for k in range(envelope.shape[0]):
        ahead_m, left_m = envelope[k, 0], envelope[k, 1]
        height, east, north = sample_grid(
            terrain,
            x_m + ahead_m * ahead_x - left_m * ahead_y,
            y_m + ahead_m * ahead_y + left_m * ahead_x,
        )
        weight = math.exp((height - envelope[k, 2] - below) / ENVELOPE_SOFTNESS_M)
        flat += math.exp(-envelope[k, 2] / ENVELOPE_SOFTNESS_M)
        total += weight
        slope_x += weight * east
        slope_y += weight * north
    rise = ENVELOPE_SOFTNESS_M * math.log(total / flat)
    return below + rise, slope_x / total, slope_y / total


@compile_exact
def _find_ground_plane(
    terrain: Terrain, tyre: TyreLaw, p_map_m: Vec3, axle: Vec3
) -> tuple[float, Vec3, float]:
    """Return height, upward normal and friction of the ground below a wheel's hub."""
    level = 1.0 / math.sqrt(axle[0] * axle[0] + axle[1] * axle[1] + TINY)
    height, slope_x, slope_y = sample_envelope(
        terrain, tyre.envelope, p_map_m[0], p_map_m[1], axle[1] * level, -axle[0] * level
    )
    up = 1.0 / math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    friction = sample_grid(tyre.ground_friction, p_map_m[0], p_map_m[1])[0]
    return height, (-slope_x * up, -slope_y * up, up), friction


@compile_exact
def _compute_friction(
    tyre: TyreLaw,
    grip: float,
    load_n: float,
    forward_mps: float,
    left_mps: float,
    rolled_m: float,
    bristle_m: FloatArray,
    dt_s: float,
) -> tuple[float, float]:
    """Return the friction forces along and across the wheel, N.

    `bristle_m` (2,), the deflection along and across, is stretched in place, or slides at the
    limit. Rolling lays fresh tread down: z' = v - |rolling speed| z / L, at the end of the step.
    """
    kept = tyre.relaxation_length_m / (tyre.relaxation_length_m + rolled_m)
    ahead_m = (bristle_m[0] + forward_mps * dt_s) * kept
    aside_m = (bristle_m[1] + left_mps * dt_s) * kept
    stiffness, damping = tyre.bristle_stiffness_npm, tyre.bristle_damping_nspm / dt_s
    forward_n = -stiffness * ahead_m - damping * (ahead_m - bristle_m[0])
    left_n = -stiffness * aside_m - damping * (aside_m - bristle_m[1])
    bristle_m[0], bristle_m[1] = ahead_m, aside_m
    along = forward_n / (min(tyre.friction_longitudinal, grip) * load_n + TINY)
    across = left_n / (min(tyre.friction_lateral, grip) * load_n + TINY)
    excess = along * along + across * across
    if excess > 1.0:
        scale = 1.0 / math.sqrt(excess)
        forward_n, left_n = forward_n * scale, left_n * scale
        bristle_m[0], bristle_m[1] = -forward_n / stiffness, -left_n / stiffness
    return forward_n, left_n


@compile_exact
def apply_tyre_forces(
    wheel_body: npt.NDArray[np.int64],
    centre: FloatArray,
    com: FloatArray,
    rotation: FloatArray,
    velocity: FloatArray,
    velocity_at: FloatArray,
    wrench: FloatArray,
    tyre: TyreLaw,
    terrain: Terrain,
    bristle_m: FloatArray,
    dt_s: float,
) -> None:
    """Write the force and torque of the soil on each wheel into MuJoCo's `xfrc_applied`.

    `centre`, `com`, `rotation` (xpos, xipos, xmat) and `velocity` (cvel: angular, linear at
    the point `velocity_at`) are MuJoCo's, row = body; the axle is the wheel body's y axis.
    `bristle_m` (wheels, 2) keeps the deflection along and across each wheel.
    """
    for k in range(wheel_body.shape[0]):
        b = wheel_body[k]
        hub = (centre[b, 0], centre[b, 1], centre[b, 2])
        axle = (rotation[b, 1], rotation[b, 4], rotation[b, 7])
        height, normal, grip = _find_ground_plane(terrain, tyre, hub, axle)
        arm_m = (hub[2] - height) * normal[2]
        if arm_m >= tyre.radius_m:
            wrench[b, :] = 0.0
            bristle_m[k, :] = 0.0
            continue
        forward = _cross(axle, normal)
        forward = _scale(forward, 1.0 / math.sqrt(_dot(forward, forward) + TINY))
        left = _cross(normal, forward)
        spin = (velocity[b, 0], velocity[b, 1], velocity[b, 2])
        contact = _add(hub, _scale(normal, -arm_m))
        lever = _add(contact, (-velocity_at[0], -velocity_at[1], -velocity_at[2]))
        slip = _add((velocity[b, 3], velocity[b, 4], velocity[b, 5]), _cross(spin, lever))
        spring_n = tyre.normal_stiffness_npm * (tyre.radius_m - arm_m)
        load_n = max(0.0, spring_n - tyre.normal_damping_nspm * _dot(slip, normal))
        spin_radps = _dot(spin, axle)
        forward_n, left_n = _compute_friction(
            tyre, grip, load_n, _dot(slip, forward), _dot(slip, left),
            math.fabs(spin_radps) * arm_m * dt_s, bristle_m[k], dt_s,
        )  # fmt: skip
        drag_nm = -tyre.rolling_resistance * load_n * tyre.radius_m
        drag_nm *= math.tanh(spin_radps / ROLLING_FADE_RADPS)
        force = _add(_scale(normal, load_n), _add(_scale(forward, forward_n), _scale(left, left_n)))
        arm = _add(contact, (-com[b, 0], -com[b, 1], -com[b, 2]))
        torque = _add(_cross(arm, force), _scale(axle, drag_nm))
        wrench[b, 0], wrench[b, 1], wrench[b, 2] = force
        wrench[b, 3], wrench[b, 4], wrench[b, 5] = torque


@compile_exact
def _find_soil_plane(
    tyre: TyreLaw, soil: SoilLaw, terrain: Terrain, hub: Vec3, axle: Vec3
) -> tuple[float, Vec3, float, float]:
    """Return height, upward normal, friction and depth of the rut below a wheel's tread."""
    level = 1.0 / math.sqrt(axle[0] * axle[0] + axle[1] * axle[1] + TINY)
    left_x, left_y = axle[0] * level, axle[1] * level
    half_m, side_m = TREAD_AHEAD * tyre.radius_m, TREAD_ASIDE * soil.width_m
    height, rut_m, along, across = 0.0, 0.0, 0.0, 0.0
    for corner in range(4):
        ahead = 1.0 if corner < 2 else -1.0
        aside = 1.0 if corner % 2 else -1.0
        x_m = hub[0] + ahead * half_m * left_y + aside * side_m * left_x
        y_m = hub[1] - ahead * half_m * left_x + aside * side_m * left_y
        here_m = sample_grid(terrain, x_m, y_m)[0]
        rut_m += 0.25 * sample_grid(soil.sunk, x_m, y_m)[0]
        height += 0.25 * here_m
        along += ahead * here_m / (4.0 * half_m)
        across += aside * here_m / (4.0 * side_m)
    slope_x, slope_y = along * left_y + across * left_x, across * left_y - along * left_x
    up = 1.0 / math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    friction = sample_grid(tyre.ground_friction, hub[0], hub[1])[0]
    return height, (-slope_x * up, -slope_y * up, up), friction, rut_m


@compile_exact
def _compute_sinkage(
    soil: SoilLaw,
    stiffness_npm: float,
    sunk_m: float,
    press_n: float,
    slip: float,
    renewed: float,
    sink_m: float,
) -> tuple[float, float, float]:
    """Return the sinkage, m, how much of it springs back, m, and the resistance of the soil, N.

    `sunk_m` is the depth of the rut that is there, `renewed` the share of the contact that is new.
    The tyre above gives way to what it does with `stiffness_npm`; that counts in the same step.
    """
    slip = min(slip, MOST_SLIP)
    packed_m = (soil.sink_scale * press_n) ** soil.sink_power
    whole_m = packed_m * (1.0 + slip) / (1.0 - 0.5 * slip)
    hard_m = soil.hardening_ratio * sunk_m
    back_m = soil.elastic_ratio * whole_m
    wanted_m = max(whole_m - hard_m, back_m)
    relief = stiffness_npm * soil.sink_power * whole_m / (press_n + TINY)
    sink_m += renewed * (wanted_m - sink_m) / (1.0 + renewed * (1.0 + relief))
    # The part that slip digs out is not pressed.
    deep_m = min(sink_m + hard_m, packed_m)
    if deep_m <= hard_m:
        return sink_m, back_m, 0.0
    power = soil.exponent + 1.0
    pressed = deep_m**power
    if hard_m > 0.0:
        pressed -= hard_m**power
    return sink_m, back_m, soil.width_m * soil.modulus * pressed / power


@compile_exact
def _compute_shear(
    soil: SoilLaw,
    tyre: TyreLaw,
    grip: float,
    load_n: float,
    length_m: float,
    forward_mps: float,
    left_mps: float,
    rolled_m: float,
    sheared_m: FloatArray,
    dt_s: float,
) -> tuple[float, float]:
    """Return the forces along and across the wheel, N; `sheared_m` (2,) moves in place.

    Rolling brings unsheared soil into a contact of `length_m`, as it brings fresh tread.
    """
    kept = length_m / (length_m + rolled_m)
    ahead_m = (sheared_m[0] + forward_mps * dt_s) * kept
    aside_m = (sheared_m[1] + left_mps * dt_s) * kept
    stiffer = 1.0 / soil.aside_ratio  # the aside ratio of the soil counts for more
    far_m = math.sqrt(ahead_m * ahead_m + (aside_m * stiffer) ** 2) + TINY
    limit = min(tyre.friction_longitudinal, tyre.friction_lateral, grip)
    most_n = min(
        soil.adhesion_npm * length_m + load_n * soil.tan_friction,
        load_n * min(limit, soil.most_traction),
    )
    left_over = math.exp(-far_m / soil.shear_m)
    secant = most_n * (1.0 - left_over) / far_m
    damping = soil.shear_damping_spm * load_n * left_over / dt_s
    forward_n = -secant * ahead_m - damping * (ahead_m - sheared_m[0])
    left_n = -stiffer * (secant * aside_m + damping * (aside_m - sheared_m[1]))
    within = min(1.0, MOST_SHEAR * soil.shear_m / far_m)
    sheared_m[0], sheared_m[1] = ahead_m * within, aside_m * within
    total = math.sqrt(forward_n * forward_n + left_n * left_n)
    if total > most_n:
        forward_n, left_n = forward_n * most_n / total, left_n * most_n / total
    return forward_n, left_n


@compile_exact
def _press_rut(
    terrain: Terrain,
    soil: SoilLaw,
    x_m: float,
    y_m: float,
    east: float,
    north: float,
    half_m: float,
    depth_m: float,
) -> None:
    """Lower the ground behind a wheel at (x, y) that moves to (east, north), to `depth_m`."""
    step_m, sunk = terrain.resolution_m, soil.sunk.values
    u = (x_m - terrain.x_min_m) / step_m - RUT_BEHIND * east
    v = (y_m - terrain.y_min_m) / step_m - RUT_BEHIND * north
    half = max(half_m / step_m, RUT_HALF)
    wall = max(1.0, depth_m / (step_m * RUT_WALL_SLOPE))
    reach = half + wall + RUT_HALF
    rows, columns = sunk.shape
    for j in range(max(1, math.ceil(v - reach)), min(rows - 1, math.floor(v + reach) + 1)):
        for i in range(max(1, math.ceil(u - reach)), min(columns - 1, math.floor(u + reach) + 1)):
            along = (i - u) * east + (j - v) * north
            aside = (j - v) * east - (i - u) * north
            # Steeper walls slide in.
            share = min(1.0, 1.0 - (math.fabs(aside) - half) / wall)
            more_m = depth_m * share - sunk[j, i]
            if math.fabs(along) > RUT_HALF or more_m <= 0.0:
                continue
            sunk[j, i] += more_m
            terrain.values[j, i] -= more_m


@compile_exact
def _make_ground_axes(axle: Vec3, normal: Vec3) -> tuple[Vec3, Vec3]:
    """Return the unit vectors forward and to the left in the plane of the ground."""
    forward = _cross(axle, normal)
    forward = _scale(forward, 1.0 / math.sqrt(_dot(forward, forward) + TINY))
    return forward, _cross(normal, forward)


@compile_exact
def apply_soil_forces(
    wheel_body: npt.NDArray[np.int64],
    centre: FloatArray,
    com: FloatArray,
    rotation: FloatArray,
    velocity: FloatArray,
    velocity_at: FloatArray,
    wrench: FloatArray,
    tyre: TyreLaw,
    soil: SoilLaw,
    terrain: Terrain,
    sheared_m: FloatArray,
    state: FloatArray,
    dt_s: float,
) -> None:
    """Write what soil that gives way does to the wheels, as `apply_tyre_forces` for hard ground.

    `sheared_m` (wheels, 2) is how far each wheel has sheared the soil, `state` (wheels,
    SOIL_STATES) its sinkage and the way since it last pressed a rut.
    """
    for k in range(wheel_body.shape[0]):
        b = wheel_body[k]
        hub = (centre[b, 0], centre[b, 1], centre[b, 2])
        axle = (rotation[b, 1], rotation[b, 4], rotation[b, 7])
        height, normal, grip, rut_m = _find_soil_plane(tyre, soil, terrain, hub, axle)
        clear_m = (hub[2] - height) * normal[2]
        if clear_m >= tyre.radius_m:
            wrench[b, :] = 0.0
            sheared_m[k, :] = 0.0
            state[k, SINK] = 0.0
            continue
        forward, left = _make_ground_axes(axle, normal)
        arm_m = clear_m + min(state[k, SINK], tyre.radius_m - clear_m)
        spin = (velocity[b, 0], velocity[b, 1], velocity[b, 2])
        contact = _add(hub, _scale(normal, -arm_m))
        lever = _add(contact, (-velocity_at[0], -velocity_at[1], -velocity_at[2]))
        slip = _add((velocity[b, 3], velocity[b, 4], velocity[b, 5]), _cross(spin, lever))
        speeds_mps = (_dot(slip, forward), _dot(slip, left), _dot(slip, normal))
        over = SoilContact(grip, rut_m, arm_m, speeds_mps, _dot(spin, axle) * arm_m)
        load_n, shear_n, held_n = _stand_on_soil(tyre, soil, over, sheared_m[k], state[k], dt_s)
        _leave_rut(tyre, soil, terrain, over, hub, forward, left, state[k], dt_s)
        fade = math.tanh(_dot(spin, axle) / ROLLING_FADE_RADPS)
        drag_nm = -tyre.rolling_resistance * load_n * tyre.radius_m * fade
        sheared = _add(_scale(forward, shear_n[0]), _scale(left, shear_n[1]))
        force, to_com = _add(_scale(normal, load_n), sheared), (-com[b, 0], -com[b, 1], -com[b, 2])
        # The soil in front presses on the rim towards the hub, so that it does not turn the wheel.
        _write_wrench(
            wrench[b], _add(contact, to_com), force, _add(hub, to_com), _scale(forward, held_n),
            _scale(axle, drag_nm),
        )  # fmt: skip


@compile_exact
def _write_wrench(
    wrench: FloatArray, arm_m: Vec3, force: Vec3, held_arm_m: Vec3, held: Vec3, torque: Vec3
) -> None:
    """Write the sum of two forces at their arms and of a torque, `wrench` (6,)."""
    turning = _add(torque, _add(_cross(arm_m, force), _cross(held_arm_m, held)))
    wrench[0], wrench[1], wrench[2] = _add(force, held)
    wrench[3], wrench[4], wrench[5] = turning


@compile_exact
def _stand_on_soil(
    tyre: TyreLaw,
    soil: SoilLaw,
    contact: SoilContact,
    sheared_m: FloatArray,
    state: FloatArray,
    dt_s: float,
) -> tuple[float, tuple[float, float], float]:
    """Return load, forces along and across, and resistance along, N.

    `sheared_m` (2,) and `state` (SOIL_STATES,) move on.
    """
    pressed_m = tyre.radius_m - contact.arm_m
    spring_n = tyre.normal_stiffness_npm * pressed_m
    load_n = max(0.0, spring_n - tyre.normal_damping_nspm * contact.slip_mps[2])
    ahead_mps = contact.slip_mps[0] + contact.rolling_mps
    speed_mps = math.sqrt(ahead_mps * ahead_mps + contact.slip_mps[1] * contact.slip_mps[1])
    length_m = _measure_contact(tyre, soil, pressed_m, state[SINK])
    far_m = math.sqrt(sheared_m[0] * sheared_m[0] + sheared_m[1] * sheared_m[1])
    renewed = dt_s * (speed_mps / length_m + 1.0 / SINKING_S)
    state[SINK], state[BACK], resistance_n = _compute_sinkage(
        soil, tyre.normal_stiffness_npm, contact.rut_m, spring_n, far_m / length_m, renewed,
        state[SINK],
    )  # fmt: skip
    shear_n = _compute_shear(
        soil, tyre, contact.grip, load_n, length_m, contact.slip_mps[0], contact.slip_mps[1],
        math.fabs(contact.rolling_mps) * dt_s, sheared_m, dt_s,
    )  # fmt: skip
    drag_n = -resistance_n * math.tanh(ahead_mps / COMPACTION_FADE_MPS)
    return load_n, shear_n, drag_n


@compile_exact
def _measure_contact(tyre: TyreLaw, soil: SoilLaw, pressed_m: float, sink_m: float) -> float:
    """Return the length of the contact, m: of soil and tyre ahead of the hub and behind it."""
    double_m, behind_m = 2.0 * tyre.radius_m, pressed_m + soil.elastic_ratio * sink_m
    return math.sqrt(double_m * (pressed_m + sink_m)) + math.sqrt(double_m * behind_m) + TINY


@compile_exact
def _leave_rut(
    tyre: TyreLaw,
    soil: SoilLaw,
    terrain: Terrain,
    contact: SoilContact,
    hub: Vec3,
    forward: Vec3,
    left: Vec3,
    state: FloatArray,
    dt_s: float,
) -> None:
    """Press the ground behind a wheel that has moved on."""
    ahead_mps, left_mps = contact.slip_mps[0] + contact.rolling_mps, contact.slip_mps[1]
    speed_mps = math.sqrt(ahead_mps * ahead_mps + left_mps * left_mps)
    state[WAY] += speed_mps * dt_s
    if state[WAY] <= RUT_EVERY * terrain.resolution_m:
        return
    state[WAY] = 0.0
    east = (forward[0] * ahead_mps + left[0] * left_mps) / speed_mps
    north = (forward[1] * ahead_mps + left[1] * left_mps) / speed_mps
    length_m = _measure_contact(tyre, soil, tyre.radius_m - contact.arm_m, state[SINK])
    swept = math.fabs(ahead_mps) * soil.width_m + math.fabs(left_mps) * length_m
    depth_m = min(contact.rut_m + max(0.0, state[SINK] - state[BACK]), tyre.radius_m)
    _press_rut(terrain, soil, hub[0], hub[1], east, north, 0.5 * swept / speed_mps, depth_m)


@compile_exact
def _move_toward(value: float, target: float, limit: float) -> float:
    return value + min(max(target - value, -limit), limit)


@compile_exact
def run_board(state: FloatArray, board: Board, views: StateViews, dt_s: float) -> None:
    """Run one step of the motor board, `state` (BOARD_SIZE,): timeout, ramps, wheel control.

    The order of the wheels is right, left, rear first; each takes the speed of its side.
    """
    state[BOARD_TIME_LEFT] -= dt_s
    alive = 1.0 if state[BOARD_TIME_LEFT] > 0.0 else 0.0
    v = _move_toward(state[BOARD_V], alive * state[BOARD_TARGET_V], board.max_accel_mps2 * dt_s)
    yaw_rate = _move_toward(
        state[BOARD_YAW_RATE],
        alive * state[BOARD_TARGET_YAW_RATE],
        board.max_yaw_accel_radps2 * dt_s,
    )
    state[BOARD_V], state[BOARD_YAW_RATE] = v, yaw_rate
    side = yaw_rate * board.half_separation_m
    right, left = (v + side) / board.wheel_radius_m, (v - side) / board.wheel_radius_m
    ctrl, speed = views.ctrl, views.qvel[6:]
    for k in range(ctrl.shape[0]):
        state[BOARD_TARGET + k] = left if k % 2 else right
        ctrl[k] = _run_pid(k, state, board, speed[k], dt_s)
        if not board.is_effort:
            # MuJoCo's servo gets the speed that makes this torque, and reduces it within the
            # step; a trace more keeps it at its limit.
            ctrl[k] = speed[k] + ctrl[k] / board.p_nmspr * (1.0 + TINY)


@compile_exact
def _run_pid(k: int, state: FloatArray, board: Board, speed_radps: float, dt_s: float) -> float:
    """Return the torque for wheel `k`, Nm; at the limit the integral does not grow."""
    error = state[BOARD_TARGET + k] - speed_radps
    slowing = (state[BOARD_SPEED + k] - speed_radps) / dt_s
    state[BOARD_SPEED + k] = speed_radps
    integral = state[BOARD_INTEGRAL + k] + board.i_nmprad * error * dt_s
    wanted = board.p_nmspr * error + integral + board.d_nms2prad * slowing
    torque: float = min(max(wanted, -board.torque_nm), board.torque_nm)
    if wanted == torque or error * wanted < 0.0:
        state[BOARD_INTEGRAL + k] = integral
    return torque


@compile_exact
def watch_wheels(state: FloatArray, board: Board, views: StateViews, dt_s: float) -> None:
    """Count in `state` (BOARD_SIZE,) how long each wheel has been stuck or without torque, s."""
    limit = board.torque_nm
    for k in range(views.ctrl.shape[0]):
        target, speed = state[BOARD_TARGET + k], views.qvel[6 + k]
        wanted = views.ctrl[k]
        if not board.is_effort:
            wanted = min(max(board.p_nmspr * (wanted - speed), -limit), limit)
        is_stuck = math.fabs(target) > FAULT_MIN_RADPS and (
            math.fabs(speed) < FAULT_RATIO * math.fabs(target)
        )
        is_powerless = math.fabs(wanted) > FAULT_RATIO * limit and (
            math.fabs(views.actuator_force[k]) < FAULT_RATIO * math.fabs(wanted)
        )
        lasted_s = state[BOARD_FAULT_TIME + k] + dt_s
        state[BOARD_FAULT_TIME + k] = lasted_s if is_stuck or is_powerless else 0.0


@compile_exact
def compute_battery_power(motor: Motor, torque_nm: float, speed_radps: float) -> float:
    """Return what a motor with its gear and controller draws from the battery, W.

    I = T / k + I0 and V = R I + k w at the wheel. What comes back while braking heats the bridge,
    but for the share that the controller recovers.
    """
    rolling = math.tanh(speed_radps / ROLLING_FADE_RADPS)
    efficiency = motor.gear_efficiency_ratio
    is_driving = torque_nm * speed_radps >= 0.0
    geared_nm = torque_nm / efficiency if is_driving else torque_nm * efficiency
    current_a = geared_nm / motor.torque_constant_nmpa + motor.no_load_a * rolling
    power_w = current_a * (
        motor.resistance_ohm * current_a + motor.torque_constant_nmpa * speed_radps
    )
    if power_w < 0.0:
        return power_w * motor.regeneration_ratio
    return power_w / motor.controller_efficiency_ratio


@compile_exact
def _record_middle(
    row: FloatArray, views: StateViews, board_state: FloatArray, motor: Motor
) -> tuple[float, float]:
    """Write the wheels between the corners into `row`; return their work and what they draw, W."""
    qpos, qvel, force = views.qpos, views.qvel, views.actuator_force
    middle, work, drawn = force.shape[0] - 4, 0.0, 0.0
    for j in range(middle):
        k, at = 4 + j, HISTORY_COLUMNS + j
        row[at] = qpos[7 + k]
        row[at + middle] = qvel[6 + k]
        row[at + 2 * middle] = force[k]
        row[at + 3 * middle] = board_state[BOARD_TARGET + k]
        fault_s = board_state[BOARD_FAULT_TIME + k]
        row[at + 4 * middle] = 1.0 if fault_s > FAULT_AFTER_S else 0.0
        row[27] += math.fabs(force[k])
        work += math.fabs(force[k] * qvel[6 + k])
        drawn += compute_battery_power(motor, force[k], qvel[6 + k])
    return work, drawn


@compile_exact
def record(
    row: FloatArray,
    last: FloatArray,
    views: StateViews,
    inertial: Inertial,
    dt_s: float,
    board_state: FloatArray,
    motor: Motor,
) -> None:
    """Write the state into `row` of the history; `last` is the row of the step before."""
    qpos, qvel, force = views.qpos, views.qvel, views.actuator_force
    # Element by element: assigning slices would double the time of the first compilation.
    for i in range(13):
        row[i] = qpos[i] if i < 7 else qvel[i - 7]
    w, x, y, z = qpos[3], qpos[4], qpos[5], qpos[6]
    # Change of velocity plus what gravity hides, turned into base axes.
    d0, d1 = qvel[0] - last[7], qvel[1] - last[8]
    d2 = qvel[2] - last[9] + inertial.gravity_mps2 * dt_s
    g0 = (1 - 2 * (y * y + z * z)) * d0 + 2 * (x * y + w * z) * d1 + 2 * (x * z - w * y) * d2
    g1 = 2 * (x * y - w * z) * d0 + (1 - 2 * (x * x + z * z)) * d1 + 2 * (y * z + w * x) * d2
    g2 = 2 * (x * z + w * y) * d0 + 2 * (y * z - w * x) * d1 + (1 - 2 * (x * x + y * y)) * d2
    # Lever arm of the IMU: alpha x r + omega x (omega x r).
    o0, o1, o2 = qvel[3], qvel[4], qvel[5]
    e0, e1, e2 = o0 - last[10], o1 - last[11], o2 - last[12]
    r0, r1, r2 = inertial.x_m, inertial.y_m, inertial.z_m
    u0, u1, u2 = o1 * r2 - o2 * r1, o2 * r0 - o0 * r2, o0 * r1 - o1 * r0
    row[13] = last[13] + g0 + e1 * r2 - e2 * r1 + (o1 * u2 - o2 * u1) * dt_s
    row[14] = last[14] + g1 + e2 * r0 - e0 * r2 + (o2 * u0 - o0 * u2) * dt_s
    row[15] = last[15] + g2 + e0 * r1 - e1 * r0 + (o0 * u1 - o1 * u0) * dt_s
    row[16] = last[16] + o0 * dt_s
    row[17] = last[17] + o1 * dt_s
    row[18] = last[18] + o2 * dt_s
    row[27] = math.fabs(force[0]) + math.fabs(force[1]) + math.fabs(force[2]) + math.fabs(force[3])
    work, drawn = 0.0, 0.0
    for k in range(4):
        row[19 + k] = qpos[7 + k]
        row[23 + k] = qvel[6 + k]
        row[28 + k] = force[k]
        row[32 + k] = board_state[BOARD_TARGET + k]
        row[36 + k] = 1.0 if board_state[BOARD_FAULT_TIME + k] > FAULT_AFTER_S else 0.0
        work += math.fabs(force[k] * qvel[6 + k])
        drawn += compute_battery_power(motor, force[k], qvel[6 + k])
    if force.shape[0] > 4:
        more_work, more_drawn = _record_middle(row, views, board_state, motor)
        work, drawn = work + more_work, drawn + more_drawn
    row[40] = last[40] + work * dt_s
    row[41] = last[41] + drawn * dt_s


@compile_exact
def advance(
    steps: int,
    library: Library,
    views: StateViews,
    wheel_body: npt.NDArray[np.int64],
    tyre: TyreLaw,
    soil: SoilLaw,
    terrain: Terrain,
    bristle_m: FloatArray,
    soil_state: FloatArray,
    board: Board,
    board_state: FloatArray,
    motor: Motor,
    inertial: Inertial,
    dt_s: float,
    history: FloatArray,
) -> None:
    """Advance by `steps`, writing into `history` (steps + 1, HISTORY_COLUMNS).

    `history[0]` is the state now, `history[i]` the one after step i.

    The half steps matter: soil forces must come from the velocities of this very step, else
    steps of 2 ms and more are unstable.
    """
    for i in range(steps):
        run_board(board_state, board, views, dt_s)
        call(library.step1, library.model, library.data)  # type: ignore[call-arg]
        if soil.is_rigid:
            apply_tyre_forces(
                wheel_body, views.xpos, views.xipos, views.xmat, views.cvel, views.subtree_com[1],
                views.xfrc_applied, tyre, terrain, bristle_m, dt_s,
            )  # fmt: skip
        else:
            apply_soil_forces(
                wheel_body, views.xpos, views.xipos, views.xmat, views.cvel, views.subtree_com[1],
                views.xfrc_applied, tyre, soil, terrain, bristle_m, soil_state, dt_s,
            )  # fmt: skip
        call(library.step2, library.model, library.data)
        watch_wheels(board_state, board, views, dt_s)
        record(history[i + 1], history[i], views, inertial, dt_s, board_state, motor)
