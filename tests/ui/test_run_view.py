from __future__ import annotations

from typing import get_args

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.verdicts import SILENT_S
from agribot.core.config import load
from agribot.core.fact_text import render
from agribot.core.facts import Fact, PositionNotFinite, PositionOld
from agribot.core.messages import (
    Check,
    GateStatus,
    GnssFix,
    GnssQuality,
    MissionState,
    SensorBatch,
    SensorState,
    SensorVerdict,
    TickRecord,
)
from agribot.ui import wire
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


def test_the_last_fix_is_shown_until_the_robot_calls_gnss_silent_and_the_next_one_again() -> None:
    first = samples.tick(0, np.random.default_rng(0))
    (fix,) = first.batch.gnss
    view = RunView(load("farm"))

    def show(t_s: float, *fixes: GnssFix) -> wire.GnssState | None:
        batch = SensorBatch(t_s=t_s, gnss=fixes)
        view(msgspec.structs.replace(first, batch=batch))
        shown = view.state()
        assert shown is not None
        return shown.gnss

    assert show(fix.t_s - 0.02) is None
    known = show(fix.t_s, fix)
    assert known is not None and known.quality == GnssQuality.RTK_FIXED
    assert show(fix.t_s + SILENT_S - 0.01) == known
    assert show(fix.t_s + SILENT_S + 0.01) is None
    late = msgspec.structs.replace(fix, t_s=fix.t_s + 9.0)
    assert show(late.t_s + 0.1, late) == known


def _gated(index: int, gate: GateStatus, reason: str = "", fact: Fact | None = None) -> TickRecord:
    record = samples.tick(index, np.random.default_rng(index))
    status = msgspec.structs.replace(record.status, gate=gate)
    return msgspec.structs.replace(record, status=status, reason=reason, fact=fact)


def test_the_gate_is_shown_since_it_is_so_and_its_reason_once() -> None:
    view = RunView(load("farm"))
    checks = (
        Check(name="clock", is_ok=True),
        Check(name="field", is_ok=False, text="outside"),
        Check(name="contactor", is_ok=True, text="none"),
    )
    view(_gated(0, GateStatus(state="checking", reason="outside", checks=checks)))
    for index in range(1, 9):
        fact = PositionNotFinite() if index > 4 else PositionOld(1.0, 0.3)
        held, said = render(fact), fact if index == 8 else None
        gate = GateStatus(state="held", reason=held, fact=fact)
        view(_gated(index, gate, reason=render(said), fact=said))
        shown = view.state()
        assert shown is not None and shown.gate is not None
        assert (shown.gate.state, shown.gate.since_s) == ("held", 0.04)
        assert (shown.gate.reason, shown.reason) == (("", held) if index == 8 else (held, ""))
        assert shown.checks == [
            wire.StartCheck(name="clock"),
            wire.StartCheck(name="field", wrong="outside"),
            wire.StartCheck(name="contactor", remark="none"),
        ]


def test_only_sensors_that_are_not_fine_cross_the_wire() -> None:
    record = samples.tick(0, np.random.default_rng(0))
    view = RunView(load("farm"))
    view(record)
    shown = view.state()
    assert shown is not None and shown.doubts == []
    for state in get_args(SensorState):
        verdict = SensorVerdict(state=state, since_s=1.0, reason="why")
        estimate = msgspec.structs.replace(record.estimate, verdicts={"clock": verdict})
        view(msgspec.structs.replace(record, estimate=estimate))
        shown = view.state()
        assert shown is not None
        doubt = wire.SensorDoubt(sensor="clock", state=state, since_s=1.0, reason="why")
        assert shown.doubts == ([] if state == "fine" else [doubt])
