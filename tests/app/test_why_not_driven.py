"""Why a row was not driven: the robot left it out, the run ended, or the operator ended it."""

from __future__ import annotations

import pytest

from agribot.app.report_card import explain_not_driven
from agribot.app.unattended import INTERRUPTED
from agribot.core.messages import MissionState, MissionStatus


@pytest.mark.parametrize(
    ("state", "why_ended", "reason"),
    [
        ("done", "", "row not driven"),
        ("running", INTERRUPTED, "run ended by the operator"),
        ("running", "stopped after 20 s, as asked", "run ended early"),
        ("failed", "", "run ended early"),
        ("cancelled", "", "run ended by the operator"),
    ],
)
def test_ground_that_was_not_driven_has_the_reason_of_the_runs_end(
    state: MissionState, why_ended: str, reason: str
) -> None:
    status = MissionStatus(
        state=state, reason="", row=0, rows_total=2, rows_done=(), s_m=0.0, length_m=9.0,
        waypoints_total=0, waypoints_reached=0,
    )  # fmt: skip
    assert explain_not_driven(status, why_ended) == reason
