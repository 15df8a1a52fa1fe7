"""What the last gate before the motors does, and why."""

from __future__ import annotations

from typing import Literal

import msgspec

from agribot.core.facts import AnyFact

GateState = Literal["standby", "checking", "driving", "slowed", "held", "stopped", "by hand"]


class Check(msgspec.Struct, frozen=True, kw_only=True):
    """One item of the list that is gone through before the first motion of a mission.

    `fact` is what is wrong; of one that is good, what is to be known of it. `text` is its text.
    """

    name: str
    is_ok: bool
    text: str = ""
    fact: AnyFact | None = None


class GateStatus(msgspec.Struct, frozen=True, kw_only=True):
    """State of the gate and why it is in it.

    `warning` is what is wrong though the robot may drive. `checks` is the list before the start, in
    a tick in which its outcome changed; else it is empty. `reason` and `warning` are the texts of
    `fact` and `warning_fact`. Recordings call the last two `told` and `told_fact`.
    """

    state: GateState = "standby"
    reason: str = ""
    warning: str = msgspec.field(name="told", default="")
    checks: tuple[Check, ...] = ()
    fact: AnyFact | None = None
    warning_fact: AnyFact | None = msgspec.field(name="told_fact", default=None)
