"""The robot, the fixed obstacles and the walkers as a MuJoCo model: its wheels on a free base.

Walkers are bodies that are put in their place. Wheels and chassis collide with these and with
obstacles only; the ground acts through the tyre kernel.
"""

from __future__ import annotations

import logging

import mujoco
import numpy as np

from agribot.core.errors import DescriptionError
from agribot.core.geo import inverse, transform
from agribot.core.messages import FloatArray
from agribot.core.robot import Link, RobotSpec, Shape
from agribot.core.world import Obstacle, WorldSpec

ROBOT_BIT, OBSTACLE_BIT = 1, 2
BASE = "base_link"
WALKER = "walker:"  # mark before the names of walkers: obstacles may have the same
PART_MARK = "#"  # mark between the name of an obstacle and the number of its part
# Rubber or paint on a wall; more lets the wheels climb it and turn the light robot over.
OBSTACLE_FRICTION = (0.3, 0.005, 0.0001)
KINDS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
}
_LOG = logging.getLogger(__name__)


def build_model(
    robot: RobotSpec, world: WorldSpec, step_s: float, *, is_effort: bool = False
) -> mujoco.MjModel:
    """Compile the model; body 1 is the base, then the wheels in the order of `wheel_names`.

    The motors take wheel speeds, or torques with `is_effort`.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep = step_s
    spec.option.gravity = [0.0, 0.0, -world.gravity_mps2]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # A diverging state must surface as an error, not restart the robot at its spawn.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    base = spec.worldbody.add_body(name=BASE)
    base.add_freejoint()
    _add_base(base, robot)
    for name in robot.wheel_names:
        _add_wheel(spec, base, robot, name, is_effort)
    for obstacle in world.obstacles:
        if obstacle.collides:
            _add_obstacle(spec.worldbody, obstacle)
    for walker in world.walkers:
        body = spec.worldbody.add_body(name=f"{WALKER}{walker.name}", mocap=True)
        _add_solids(body, np.eye(4), walker.shapes, walker.name, f"{WALKER}{walker.name}")
    return spec.compile()


def find_obstacle_boxes(world: WorldSpec) -> FloatArray:
    """Return the boxes of the colliding shapes in plan view, (N, 4).

    Columns, in the map: centre x, y and half sizes along x, y.
    """
    boxes = []
    for obstacle in world.obstacles:
        map_from_obstacle = _make_obstacle_pose(obstacle)
        for shape in obstacle.shapes if obstacle.collides else ():
            if shape.kind in KINDS:
                pose = map_from_obstacle @ shape.origin.matrix()
                half_m = np.abs(pose[:2, :3]) @ compute_half_sizes_m(shape)
                boxes.append((*pose[:2, 3], *half_m))
    return np.array(boxes, dtype=np.float64).reshape(-1, 4)


def compute_half_sizes_m(shape: Shape) -> FloatArray:
    """Return the half sizes (3,) of the box around a shape, in the shape's axes."""
    x, y, z = shape.size_m
    if shape.kind == "box":
        return np.array([x, y, z]) / 2.0
    return np.array([x, x, y / 2.0 if shape.kind == "cylinder" else x])


def _add_base(body: mujoco.MjsBody, robot: RobotSpec) -> None:
    parts = [
        (robot.base_from_link(link.name), link)
        for link in robot.links
        if find_carrier(robot, link.name) == BASE
    ]
    _set_inertia(body, parts)
    for base_from_link, link in parts:
        for shape in link.collisions:
            _add_shape(body, base_from_link, shape, ROBOT_BIT, link.name)


def _add_wheel(
    spec: mujoco.MjSpec, base: mujoco.MjsBody, robot: RobotSpec, name: str, is_effort: bool
) -> None:
    """Add a wheel on a hinge; the wheel body's y axis is the axle and points to the left."""
    base_from_link = robot.base_from_link(name)
    joint = next((j for j in robot.joints if j.child == name), None)
    if joint is None:
        raise DescriptionError(f"robot '{robot.name}': wheel '{name}' has no joint; add one")
    base_from_wheel = _make_axle_frame(base_from_link[:3, 3], base_from_link[:3, :3] @ joint.axis)
    wheel_from_base = inverse(base_from_wheel)
    body = base.add_body(
        name=name, pos=base_from_wheel[:3, 3], quat=_to_quaternion(base_from_wheel[:3, :3])
    )
    parts = [
        (wheel_from_base @ robot.base_from_link(link.name), link)
        for link in robot.links
        if find_carrier(robot, link.name) == name
    ]
    _set_inertia(body, parts)
    drive = robot.drive
    body.add_joint(
        name=joint.name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0.0, 1.0, 0.0],
        armature=drive.rotor_inertia_kgm2,
        damping=joint.damping_nmspr,
        frictionloss=joint.friction_nm,
    )
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[drive.wheel_radius_m, drive.wheel_width_m / 2.0, 0.0],
        quat=[np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0],
        contype=ROBOT_BIT,
        conaffinity=OBSTACLE_BIT,
        friction=OBSTACLE_FRICTION,
    )
    motor = spec.add_actuator(name=name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    if is_effort:
        motor.set_to_motor()
    else:
        motor.set_to_velocity(kv=drive.servo_gain_nmspr)
    motor.forcelimited = True
    motor.forcerange = [-drive.wheel_torque_nm, drive.wheel_torque_nm]


def find_carrier(robot: RobotSpec, name: str) -> str:
    """Return the moving body that a link is part of: the wheel above it, else the base."""
    parents = {joint.child: joint.parent for joint in robot.joints}
    wheels = robot.wheel_names
    while name not in wheels and name in parents:
        name = parents[name]
    return name if name in wheels else BASE


def _make_axle_frame(centre_m: FloatArray, axle: FloatArray) -> FloatArray:
    """Return a wheel's pose in the base, (4, 4): y along the axle to the left, x forward."""
    left = axle / np.linalg.norm(axle)
    if abs(left[1]) < 0.7:
        raise DescriptionError(
            f"wheel axle {left.round(3).tolist()} is not across the robot; "
            "a wheel joint must turn about the body's y axis"
        )
    left = left * np.sign(left[1])
    forward = np.cross(left, [0.0, 0.0, 1.0])
    forward /= np.linalg.norm(forward)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack((forward, left, np.cross(forward, left)))
    pose[:3, 3] = centre_m
    return pose


def _set_inertia(body: mujoco.MjsBody, parts: list[tuple[FloatArray, Link]]) -> None:
    """Combine links into one rigid body (parallel axis theorem)."""
    masses, centres, tensors = [], [], []
    for body_from_link, link in parts:
        body_from_com = body_from_link @ link.com.matrix()
        ixx, iyy, izz, ixy, ixz, iyz = link.inertia_kgm2
        tensor = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
        rotation = body_from_com[:3, :3]
        masses.append(link.mass_kg)
        centres.append(body_from_com[:3, 3])
        tensors.append(rotation @ tensor @ rotation.T)
    mass_kg = sum(masses)
    if mass_kg <= 0.0:
        raise DescriptionError(f"body '{body.name}' has no mass; give its links an <inertial>")
    com = sum((m * c for m, c in zip(masses, centres, strict=True)), np.zeros(3)) / mass_kg
    total = np.zeros((3, 3))
    for mass, centre, tensor in zip(masses, centres, tensors, strict=True):
        arm = centre - com
        total += tensor + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    body.explicitinertial = True
    body.mass = mass_kg
    body.ipos = com
    body.fullinertia = [
        total[0, 0], total[1, 1], total[2, 2], total[0, 1], total[0, 2], total[1, 2],
    ]  # fmt: skip


def _add_obstacle(world_body: mujoco.MjsBody, obstacle: Obstacle) -> None:
    pose, name = _make_obstacle_pose(obstacle), obstacle.name
    _add_solids(world_body, pose, obstacle.shapes, name, name)


def _add_solids(
    body: mujoco.MjsBody, body_from_owner: FloatArray, shapes: tuple[Shape, ...], owner: str,
    name: str,
) -> None:  # fmt: skip
    """Add shapes that the robot can hit, each named `name` and a number."""
    for index, shape in enumerate(shapes):
        geom = _add_shape(body, body_from_owner, shape, OBSTACLE_BIT, owner)
        if geom is not None:
            geom.name = f"{name}{PART_MARK}{index}"


def _make_obstacle_pose(obstacle: Obstacle) -> FloatArray:
    return transform(
        (obstacle.x_map_m, obstacle.y_map_m, obstacle.z_map_m), (0.0, 0.0, obstacle.yaw_rad)
    )


def _add_shape(
    body: mujoco.MjsBody, body_from_owner: FloatArray, shape: Shape, bit: int, owner: str
) -> mujoco.MjsGeom | None:
    if shape.kind not in KINDS:
        _LOG.warning("'%s': %s shapes have no collision in the physics", owner, shape.kind)
        return None
    half_m = compute_half_sizes_m(shape)
    pose = body_from_owner @ shape.origin.matrix()
    return body.add_geom(
        type=KINDS[shape.kind],
        size=half_m if shape.kind == "box" else half_m[[0, 2, 2]],
        pos=pose[:3, 3],
        quat=_to_quaternion(pose[:3, :3]),
        contype=bit,
        conaffinity=(ROBOT_BIT | OBSTACLE_BIT) ^ bit,
        friction=OBSTACLE_FRICTION,
        mass=0.0,
    )


def _to_quaternion(rotation: FloatArray) -> FloatArray:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    return quaternion
