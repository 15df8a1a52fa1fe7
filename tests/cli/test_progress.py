"""What a terminal shows while a command takes long."""

from __future__ import annotations

import io
import os
import pty

import msgspec
import pytest

from agribot.autonomy.weeds.map import WeedMap
from agribot.cli.run.progress import RunProgress, explain_wait
from agribot.core.config import WeedConfig
from agribot.core.messages import Check, GateStatus
from tests.record import record_samples as samples
from tests.waiting import wait_for


def test_only_what_takes_long_is_explained(capsys: pytest.CaptureFixture[str]) -> None:
    with explain_wait("compiling", after_s=3600.0):
        pass
    assert capsys.readouterr().err == ""
    with explain_wait("compiling", after_s=0.0):
        wait_for(lambda: capsys.readouterr().err == "compiling\n", "the explanation")


def test_the_list_before_the_start_and_a_stop_are_told_at_once() -> None:
    stream = io.StringIO()
    progress = RunProgress(WeedMap(WeedConfig()), stream)
    bad = Check(name="field", is_ok=False, text="outside the geofence")
    statuses = (
        GateStatus(),
        GateStatus(state="checking", reason="outside the geofence", checks=(bad,)),
        GateStatus(state="driving", reason="over", warning="camera silent for 1.2 s > 1.0 s"),
        GateStatus(state="stopped", reason="RUNAWAY"),
        GateStatus(state="stopped", reason="RUNAWAY"),
    )
    for record, gate in zip(samples.ticks(len(statuses)), statuses, strict=True):
        status = msgspec.structs.replace(record.status, gate=gate)
        progress(msgspec.structs.replace(record, status=status))
    assert stream.getvalue().splitlines()[1:] == [
        "before the start not good: field: outside the geofence",
        "camera silent for 1.2 s > 1.0 s",
        "stopped: RUNAWAY",
    ]


def test_a_run_goes_on_where_the_terminal_was_closed_that_shows_its_progress() -> None:
    ours, theirs = pty.openpty()
    with os.fdopen(theirs, "w", encoding="utf-8") as terminal:
        progress = RunProgress(WeedMap(WeedConfig()), terminal)
        os.close(ours)
        for record in samples.ticks(3):
            progress(record)
            progress.note("the line of the board is lost")
        progress.close()
