"""A step of joints, as a table of a gamepad asks for it."""

from __future__ import annotations

from typing import NamedTuple


class JointStep(NamedTuple):
    """A step of joints of one controller, rad or m each; `name` is what a person calls it."""

    name: str
    controller: str
    joints: tuple[str, ...]
    increment_by: tuple[float, ...]
