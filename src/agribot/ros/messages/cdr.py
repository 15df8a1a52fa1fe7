"""Fast CDR for the topics of high rate.

Of such a message only the time stamp and a run of numbers change; its frame names and array
lengths never do. rosbags writes it once, and each further one is that template with the numbers
filled in: the same bytes (the tests compare them) for a tenth of the time.
"""

from __future__ import annotations

import itertools
import struct
from typing import Any

from agribot.core.messages import Estimate, GnssQuality, ImuSample, WheelSample
from agribot.ros.messages import rosmsg

_STAMP = struct.Struct("<iI")
_STAMP_AT = 4  # behind the encapsulation header; a message's header comes first
_SECOND_NS = 1_000_000_000


class CdrTemplate:
    """A serialised message with holes.

    `layout` is a struct format of everything from the first number that changes to the end of
    the message; its pad bytes become zero.
    """

    def __init__(self, message: Any, layout: str) -> None:
        self._bytes = bytearray(rosmsg.to_cdr(message))
        self._numbers = struct.Struct("<" + layout)
        self._numbers_at = len(self._bytes) - self._numbers.size

    def fill(self, *numbers: float) -> bytes:
        self._numbers.pack_into(self._bytes, self._numbers_at, *numbers)
        return bytes(self._bytes)

    def fill_stamped(self, t_ns: int, *numbers: float) -> bytes:
        sec, nanosec = divmod(t_ns, _SECOND_NS)
        _STAMP.pack_into(self._bytes, _STAMP_AT, sec, nanosec)
        self._numbers.pack_into(self._bytes, self._numbers_at, *numbers)
        return bytes(self._bytes)


class ImuCdr:
    def __init__(self, frame: str) -> None:
        still = ImuSample(t_s=0.0, gyro_radps=(0.0, 0.0, 0.0), accel_mps2=None)
        self._template = CdrTemplate(rosmsg.make_imu(still, frame), "3d72x4d64x")

    def __call__(self, t_ns: int, sample: ImuSample) -> bytes:
        """Write the numbers, and the first of the acceleration's covariance: -1 without one."""
        accel, first = sample.accel_mps2, 0.0
        if accel is None:
            accel, first = (0.0, 0.0, 0.0), -1.0
        return self._template.fill_stamped(t_ns, *sample.gyro_radps, *accel, first)


class JointStateCdr:
    """Four wheels; the lengths of the arrays lie between the numbers. Others are encoded anew."""

    def __init__(self, names: tuple[str, ...]) -> None:
        zero = (0.0, 0.0, 0.0, 0.0)
        self._names, corners = names, names[:4]
        still = WheelSample(t_s=0.0, angle_rad=zero, speed_radps=zero)
        self._template = CdrTemplate(rosmsg.make_joint_state(still, corners), "4dI4x4d4x")
        still = WheelSample(t_s=0.0, angle_rad=zero, speed_radps=zero, effort_nm=zero)
        self._with_effort = CdrTemplate(rosmsg.make_joint_state(still, corners), "4dI4x4dI4x4d")

    def __call__(self, t_ns: int, sample: WheelSample) -> bytes:
        angles, speeds, efforts = sample.angle_rad, sample.speed_radps, sample.effort_nm
        if sample.middle:
            return rosmsg.to_cdr(rosmsg.make_joint_state(sample, self._names))
        if efforts is None:
            return self._template.fill_stamped(t_ns, *angles, 4, *speeds)
        return self._with_effort.fill_stamped(t_ns, *angles, 4, *speeds, 4, *efforts)


class OdometryCdr:
    """Planar: rows and columns x, y and yaw of the 6x6 covariance, twist without lateral speed."""

    def __init__(self, parent: str = rosmsg.MAP_FRAME) -> None:
        still = Estimate(
            t_s=0.0, x_map_m=0.0, y_map_m=0.0, yaw_map_rad=0.0, v_mps=0.0, yaw_rate_radps=0.0,
            slip_rad=0.0, pose_cov=(0.0,) * 9, pos_std_m=0.0, yaw_std_rad=0.0,
            quality=GnssQuality.NONE, ok=True,
        )  # fmt: skip
        message = rosmsg.make_odometry(still)
        message.header.frame_id = parent
        pose = "2d8x16x2d"
        covariance = "2d24xd" + "2d24xd" + "144x" + "2d24xd"
        twist = "d32xd" + "288x"
        self._template = CdrTemplate(message, pose + covariance + twist)

    def __call__(self, t_ns: int, estimate: Estimate) -> bytes:
        return self.pack(
            t_ns,
            (estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad),
            estimate.pose_cov,
            (estimate.v_mps, estimate.yaw_rate_radps),
        )

    def pack(
        self,
        t_ns: int,
        pose: tuple[float, float, float],
        pose_cov: tuple[float, ...],
        twist: tuple[float, float],
    ) -> bytes:
        """Pack `pose` (x, y, yaw), its 3x3 covariance row by row, and `twist` (forward, yaw)."""
        x_m, y_m, yaw_rad = pose
        _, _, z, w = rosmsg.quaternion_from_yaw(yaw_rad)
        return self._template.fill_stamped(t_ns, x_m, y_m, z, w, *pose_cov, *twist)


class TwistCdr:
    def __init__(self) -> None:
        self._template = CdrTemplate(rosmsg.make_twist(0.0, 0.0), "d32xd")

    def __call__(self, v_mps: float, yaw_rate_radps: float) -> bytes:
        return self._template.fill(v_mps, yaw_rate_radps)


class Float64Cdr:
    def __init__(self) -> None:
        self._template = CdrTemplate(rosmsg.make_float64(0.0), "d")

    def __call__(self, value: float) -> bytes:
        return self._template.fill(value)


class ClockCdr:
    def __init__(self) -> None:
        zero = rosmsg.make_message("builtin_interfaces/msg/Time", 0, 0)
        self._template = CdrTemplate(rosmsg.make_message("rosgraph_msgs/msg/Clock", zero), "")

    def __call__(self, t_ns: int) -> bytes:
        return self._template.fill_stamped(t_ns)


class TransformsCdr:
    """A TFMessage with always the same frames; seven numbers (x y z, x y z w) each."""

    def __init__(self, frames: tuple[tuple[str, str], ...]) -> None:
        still = [
            rosmsg.make_transform(0.0, parent, child, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
            for parent, child in frames
        ]
        # A message with the first k transforms is a prefix of the whole but for the count, so
        # its length is where transform k starts.
        ends = [
            len(rosmsg.to_cdr(rosmsg.make_message("tf2_msgs/msg/TFMessage", still[:count])))
            for count in range(len(still) + 1)
        ]
        self._bytes = bytearray(rosmsg.to_cdr(rosmsg.make_message("tf2_msgs/msg/TFMessage", still)))
        self._numbers = struct.Struct("<7d")
        self._at = [(start, end - 56) for start, end in itertools.pairwise(ends)]

    def __call__(self, t_ns: int, poses: tuple[tuple[float, ...], ...]) -> bytes:
        sec, nanosec = divmod(t_ns, _SECOND_NS)
        for (stamp_at, numbers_at), pose in zip(self._at, poses, strict=True):
            _STAMP.pack_into(self._bytes, stamp_at, sec, nanosec)
            self._numbers.pack_into(self._bytes, numbers_at, *pose)
        return bytes(self._bytes)
