"""The refusal of bytes that are not the message that their topic or service carries."""

from __future__ import annotations

from agribot.core.errors import BridgeError


def make_undecodable(data: bytes, wanted: str) -> BridgeError:
    return BridgeError(f"{len(data)} bytes are not {wanted}; send that type, as ROS writes it")
