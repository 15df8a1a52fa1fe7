"""The frame tree of a run: map -> odom -> base_footprint -> robot (REP-105)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from agribot.core.geo import LINK_FROM_OPTICAL, rotation_from_rpy
from agribot.core.messages import Estimate, FloatArray, Vec3, WheelSample
from agribot.core.pose import Pose2
from agribot.core.robot import Joint, RobotSpec
from agribot.ros.messages.cdr import TransformsCdr
from agribot.ros.messages.rosmsg import (
    BODY_FRAME,
    MAP_FRAME,
    ODOM_FRAME,
    OPTICAL_FRAME,
    Quaternion,
    make_message,
    make_transform,
    quaternion_from_matrix,
    quaternion_from_yaw,
)


class BodyTransforms:
    """map -> odom -> base_footprint.

    odom is the integral of the estimated velocity: it never jumps, and drifts. map -> odom is
    the sum of the corrections, so the chain always ends at the estimated pose.
    """

    def __init__(self) -> None:
        self._cdr = TransformsCdr(((MAP_FRAME, ODOM_FRAME), (ODOM_FRAME, BODY_FRAME)))
        self._x_m = self._y_m = self._yaw_rad = 0.0
        self._t_s: float | None = None

    def __call__(self, t_ns: int, estimate: Estimate) -> bytes:
        self._advance(estimate)
        yaw = estimate.yaw_map_rad - self._yaw_rad
        turned = Pose2(estimate.x_map_m, estimate.y_map_m, yaw)
        x_m, y_m = turned.transform(-self._x_m, -self._y_m)
        map_from_odom = (x_m, y_m, 0.0, *quaternion_from_yaw(yaw))
        odom_from_body = (self._x_m, self._y_m, 0.0, *quaternion_from_yaw(self._yaw_rad))
        return self._cdr(t_ns, (map_from_odom, odom_from_body))

    def _advance(self, estimate: Estimate) -> None:
        if self._t_s is not None:
            dt_s = estimate.t_s - self._t_s
            middle = self._yaw_rad + 0.5 * estimate.yaw_rate_radps * dt_s
            self._x_m += estimate.v_mps * dt_s * math.cos(middle)
            self._y_m += estimate.v_mps * dt_s * math.sin(middle)
            self._yaw_rad += estimate.yaw_rate_radps * dt_s
        self._t_s = estimate.t_s


class WheelTransforms:
    """The turning wheels, for displays that run no robot_state_publisher."""

    def __init__(self, joints: tuple[Joint, ...]) -> None:
        self._cdr = TransformsCdr(tuple((joint.parent, joint.child) for joint in joints))
        self._mounts = tuple(
            (
                joint.origin.xyz_m,
                quaternion_from_matrix(rotation_from_rpy(*joint.origin.rpy_rad)),
                joint.axis,
            )
            for joint in joints
        )

    def __call__(self, t_ns: int, sample: WheelSample) -> bytes:
        return self._cdr(
            t_ns,
            tuple(
                (*xyz_m, *_multiply(fixed, _make_rotation(axis, angle_rad)))
                for (xyz_m, fixed, axis), angle_rad in zip(
                    self._mounts, self._list_angles_rad(sample), strict=True
                )
            ),
        )

    def _list_angles_rad(self, sample: WheelSample) -> list[float]:
        """List the angles of all wheels; without a reading that of the rear one of its side."""
        angles = [*sample.angle_rad, *(wheel.angle_rad for wheel in sample.middle)]
        return angles + [angles[k % 2] for k in range(len(angles), len(self._mounts))]


def find_wheel_joints(robot: RobotSpec, wheel_names: tuple[str, ...]) -> tuple[Joint, ...]:
    """Find the joints that carry these links, in the same order; none if one is missing."""
    by_child = {joint.child: joint for joint in robot.joints}
    if any(name not in by_child for name in wheel_names):
        return ()
    return tuple(by_child[name] for name in wheel_names)


def make_static_transforms(robot: RobotSpec) -> Any:
    """Make base_footprint down to the root link, every fixed joint, and the optical frame."""
    children = {joint.child for joint in robot.joints}
    transforms = [
        _make_static(BODY_FRAME, link.name, robot.body_from_link(link.name))
        for link in robot.links
        if link.name not in children and link.name != BODY_FRAME
    ]
    transforms += [
        _make_static(joint.parent, joint.child, joint.origin.matrix())
        for joint in robot.joints
        if joint.kind == "fixed"
    ]
    has_optical_link = any(link.name == OPTICAL_FRAME for link in robot.links)
    if robot.camera is not None and not has_optical_link:
        transforms.append(_make_static(robot.camera.link, OPTICAL_FRAME, LINK_FROM_OPTICAL))
    return make_message("tf2_msgs/msg/TFMessage", transforms)


def _make_static(parent: str, child: str, parent_from_child: FloatArray) -> Any:
    x_m, y_m, z_m = parent_from_child[:3, 3].tolist()
    xyzw = quaternion_from_matrix(parent_from_child[:3, :3])
    return make_transform(0.0, parent, child, (x_m, y_m, z_m), xyzw)


def _make_rotation(axis: Vec3, angle_rad: float) -> Quaternion:
    norm = float(np.linalg.norm(axis)) or 1.0
    s = math.sin(angle_rad / 2.0) / norm
    return (s * axis[0], s * axis[1], s * axis[2], math.cos(angle_rad / 2.0))


def _multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )
