from __future__ import annotations

import msgspec
import numpy as np
import pytest

from agribot.core.config import load
from agribot.core.messages import MissionState
from agribot.ui.view import RunView
from tests.record import record_samples as samples


@pytest.mark.parametrize(("state", "shown_s"), [("running", 800.0), ("paused", None)])
def test_the_page_shows_the_time_left_that_the_mission_tells(
    state: MissionState, shown_s: float | None
) -> None:
    record = samples.tick(0, np.random.default_rng(0))
    status = msgspec.structs.replace(samples.status(state), eta_s=800.04)
    view = RunView(load("farm", ["mission.speed_mps=0.4"]))
    view(msgspec.structs.replace(record, status=status))
    shown = view.state()
    assert shown is not None
    assert shown.mission is not None
    assert shown.mission.eta_s == shown_s
