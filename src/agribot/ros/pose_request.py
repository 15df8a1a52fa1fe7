"""The pose of a standing robot, stated by a peer: RViz's 2D Pose Estimate, or a service."""

from __future__ import annotations

import math
from typing import Any

from agribot.autonomy.plan.mission.errand import STANDING_MPS
from agribot.core.errors import BridgeError
from agribot.core.messages import CorrectPose
from agribot.ros.frames import PeerFrames
from agribot.ros.requests import Requests

# 1 sigma of a pose that is stated without a covariance
_UNKNOWN_STD_M, _UNKNOWN_STD_RAD = 0.5, math.radians(15.0)
_X, _Y, _YAW = 0, 7, 35  # on the diagonal of a covariance of six by six


def request_pose(
    requests: Requests,
    pose: tuple[float, float, float],
    stds: tuple[float, float],
    source: str,
) -> tuple[bool, str]:
    """Request that the robot believe a pose: x, y (m, map), yaw (rad).

    `stds` are 1 sigma of the place (m) and of the yaw (rad), 0 where they are unknown. Return
    whether it was posted, and the text for the peer.
    """
    request = CorrectPose(
        x_map_m=pose[0], y_map_m=pose[1], yaw_map_rad=pose[2],
        std_m=stds[0] or _UNKNOWN_STD_M, std_rad=stds[1] or _UNKNOWN_STD_RAD,
    )  # fmt: skip
    if text := _find_refusal(requests, request.pose):
        requests.refuse(f"{source}: pose refused: {text}")
        return False, f"pose refused: {text}"
    requests.post(request, source)
    return True, (
        f"pose handed to the robot: East {pose[0]:.2f} m, North {pose[1]:.2f} m, "
        f"{math.degrees(pose[2]):.0f} degrees counter-clockwise from East"
    )


def read_stated_pose(
    message: Any, frames: PeerFrames
) -> tuple[tuple[float, float, float], tuple[float, float]]:
    """Read a geometry_msgs/PoseWithCovarianceStamped: pose in the map, and its sigmas.

    Raises: BridgeError: not finite, no orientation, or an invalid frame or covariance.
    """
    x_m, y_m, yaw_rad = frames.find_pose(message.header.frame_id, message.pose.pose)
    if yaw_rad is None:
        raise BridgeError("the pose has no orientation; a robot that looks East has w: 1.0")
    variances = [float(message.pose.covariance[place]) for place in (_X, _Y, _YAW)]
    if not all(math.isfinite(variance) and variance >= 0.0 for variance in variances):
        raise BridgeError(f"the variances {variances} are out of range; send 0 or more")
    return (x_m, y_m, yaw_rad), (math.sqrt(max(variances[:2])), math.sqrt(variances[2]))


def _find_refusal(requests: Requests, numbers: tuple[float, ...]) -> str:
    record = requests.link.record if requests.link else None
    if not requests.allow_drive:
        return "a pose decides where the robot drives; start with --allow-drive to take it"
    if not math.isfinite(sum(numbers)):
        return "it is not finite"
    if record is None or not record.estimate.ok:
        return "the robot knows neither place nor heading yet; wait until it does"
    if abs(record.estimate.v_mps) > STANDING_MPS:
        return "the robot drives; pause its mission first"
    return ""
