"""Settings that an operator changes under way, and the replay of such a run."""

from __future__ import annotations

from pathlib import Path

from agribot.app.simulated_run import simulate
from agribot.cli.main import main
from agribot.core import config
from agribot.core.messages import ChangeSetting

SETTINGS = ["perception.enabled=false", "seed=1", "duration_s=22"]


def test_a_new_speed_counts_at_once_and_a_replay_repeats_it(tmp_path: Path) -> None:
    speeds: dict[float, float] = {}
    with simulate(config.load("farm", SETTINGS), tmp_path / "run") as session:
        for record in session.ticks():
            speeds[round(record.batch.t_s, 2)] = record.command.drive.v_mps
            if round(record.batch.t_s, 2) == 16.0:
                session.inbox.post(ChangeSetting(setting="mission.speed_mps", value=0.2))
        session.finish()
        log = [event.reason for event in session.event_log.events]
    assert max(speeds[t_s] for t_s in speeds if 14.0 < t_s < 16.0) > 0.35
    assert 0.1 < max(speeds[t_s] for t_s in speeds if t_s > 18.0) <= 0.2
    assert "sets mission.speed_mps = 0.2 (operator)" in log
    assert main(["replay", str(tmp_path / "run" / "run.mcap")]) == 0
