"""What a row of the topic table is made of."""

from __future__ import annotations

from typing import Literal

import msgspec


class Qos(msgspec.Struct, frozen=True, kw_only=True):
    """What ROS 2 offers to late or lossy subscribers; history is always keep-last."""

    reliable: bool = True
    latched: bool = False  # durability transient_local
    depth: int = 10


# A reliable publisher matches reliable and best-effort subscribers alike.
STREAM = Qos()
LATCHED = Qos(latched=True, depth=1)
LATEST = Qos(reliable=False, depth=1)

Direction = Literal["out", "in", "both"]


class Topic(msgspec.Struct, frozen=True, kw_only=True):
    """One row of the table.

    `rate_hz` is nominal, None for "when it changes". `struct` is the message that carries the
    value inside the robot, None where the content is not a struct (TF, the URDF text).
    `ros_type` is empty for a channel that only AGRIBOT reads. `seed_alias` and `seed_ros_type`
    are what the original AGRIBOT called it, for its own tools; empty where it had none.
    """

    name: str
    ros_type: str
    struct: type[msgspec.Struct] | None = None
    rate_hz: float | None = None
    qos: Qos = STREAM
    direction: Direction = "out"
    seed_alias: str = ""
    seed_ros_type: str = ""
    about: str = ""
