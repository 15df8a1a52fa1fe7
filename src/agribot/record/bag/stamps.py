"""Times that one version of ROS can hold and the other cannot.

ROS 1 counts the seconds of a time in 32 bits without a sign, from 1970 to 2106; ROS 2 in 32 bits
with one, from 1901 to 2038. The bits of a time are kept in a conversion, so that one just before
zero, as of a picture that a simulation took before it began, comes back as it was.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rosbags.interfaces import Nodetype

_TIME, _HEADER = "builtin_interfaces/msg/Time", "std_msgs/msg/Header"
_TOP_BIT, _JUST_BEFORE_ZERO = 1 << 31, (1 << 32) - 86400
UNHOLDABLE = (
    "a stamp that only one version of ROS can hold, before 1970 or after January 2038; convert "
    "to a format of the same version"
)


def make_stamp_check(
    defined: Any, ros_type: str, from_ros2: bool
) -> Callable[[bytes], bool] | None:
    """Make a check that returns whether the other version of ROS can hold a message's stamp.

    The stamp is the time that a message begins with, as all with a header do; None without one.
    """
    offset = _find_seconds(defined, ros_type, from_ros2)
    if offset is None:
        return None
    start = offset + (4 if from_ros2 else 0)  # behind the four bytes that say how a CDR is written

    def can_hold(data: bytes) -> bool:
        is_big = from_ros2 and data[1:2] == b"\0"
        seconds = int.from_bytes(data[start : start + 4], "big" if is_big else "little")
        return not _TOP_BIT <= seconds < _JUST_BEFORE_ZERO

    return can_hold


def _find_seconds(defined: Any, ros_type: str, is_ros2: bool) -> int | None:
    """Find how many bytes of the content come before its first field's seconds."""
    before = 0
    while ros_type != _TIME:
        if ros_type == _HEADER:
            return before + (0 if is_ros2 else 4)  # a ROS 1 header begins with a number
        fields = defined[ros_type][1]
        if not fields or fields[0][1][0] != Nodetype.NAME:
            return None
        ros_type = fields[0][1][1]
    return before
