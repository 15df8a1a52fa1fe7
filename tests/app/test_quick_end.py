"""SIGTERM ends a run without the figures, which take seconds; everything else is written."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.cli.run import page
from agribot.record.replay import read_ticks

FIGURES = {"report.html", "map.png"}


def run_until(signum: signal.Signals, out: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """Run the farm, and get a signal after half a second of its time."""
    received: list[float] = []

    def wait(_: page.Pacer, t_s: float) -> None:
        if t_s > 0.5 and not received:
            received.append(t_s)
            os.kill(os.getpid(), signum)

    monkeypatch.setattr(page.Pacer, "wait", wait)
    words = ["--set", "perception.enabled=false", "--for", "30", "--out", str(out)]
    return main(["run", "farm", "--headless", *words])


@pytest.mark.figures
@pytest.mark.parametrize(
    ("signum", "figures"),
    [(signal.SIGTERM, set()), (signal.SIGINT, FIGURES)],
    ids=["terminated", "interrupted"],
)
def test_a_run_that_is_to_end_writes_what_it_has_time_for(
    signum: signal.Signals, figures: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    out = tmp_path / "run"
    assert run_until(signum, out, monkeypatch) == 130
    assert "interrupted" in json.loads((out / "report.json").read_text())["reason"]
    assert len(list(read_ticks(out / "run.mcap"))) > 25
    names = {path.name for path in out.iterdir()}
    assert names & FIGURES == figures
    assert {"config.toml", "events.jsonl", "weeds.geojson"} <= names
    assert ("agribot report run.mcap -o DIR" in capsys.readouterr().err) == (not figures)
