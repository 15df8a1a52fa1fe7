"""What a check of `agribot doctor` finds, and its printed form."""

from __future__ import annotations

from typing import Literal

import msgspec

State = Literal["ok", "missing", "warning", "bad"]


class CheckResult(msgspec.Struct, frozen=True, kw_only=True):
    """Result of one check; `detail` ends with what to do about it.

    "missing" is what a robot can do without, a "warning" what will cause trouble, and only what is
    "bad" makes the doctor's answer no.
    """

    what: str
    state: State
    detail: str


def format_line(finding: CheckResult) -> str:
    return f"{finding.state:8} {finding.what}: {finding.detail}"
