"""kill -9 on the way to a place: the next run knows it, asks, gets there and finishes the work."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

from agribot.app.mission_file import continue_config, read_mission
from agribot.app.simulated_run import simulate
from agribot.core import config
from agribot.core.facts import AtGoal, CutOff, Fact, OnErrandOf
from agribot.core.messages import ControlMission, TickRecord, Who
from tests import nightly
from tests.mission.killed_errand import GOAL

ROOT = Path(__file__).parents[2]


def kill_on_the_way(out: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": f"{ROOT / 'src'}{os.pathsep}{ROOT}"}
    command = [sys.executable, "-m", "tests.mission.killed_errand", str(out)]
    process = subprocess.run(command, env=environment, cwd=ROOT, check=False)
    assert process.returncode == -signal.SIGKILL


@nightly.by_day(
    "tests/autonomy/plan/test_mission_cut_off.py::"
    "test_a_goto_waits_for_an_answer_drives_on_and_then_back_to_the_work",
    "tests/mission/test_one_job.py::test_time_distance_rows_and_errors_are_those_of_the_whole_job",
)
def test_a_run_that_was_killed_on_its_way_to_a_place_asks_and_goes_on(tmp_path: Path) -> None:
    kill_on_the_way(tmp_path / "first")
    saved = read_mission(tmp_path / "first")
    assert saved.errand is not None and saved.errand.goal == GOAL
    settings = continue_config(config.load(str(tmp_path / "first" / "config.toml")), saved)
    seen: list[Fact] = []
    at_goal: TickRecord | None = None
    with simulate(settings, tmp_path / "again", saved) as session:
        for record in session.ticks():
            status, fact = record.status, record.status.fact
            waits = status.state == "paused" and isinstance(fact, CutOff | AtGoal)
            stands = abs(record.estimate.v_mps) < 0.02
            if waits and stands and fact and (not seen or seen[-1] != fact):
                seen.append(fact)
                at_goal = record if isinstance(fact, AtGoal) else at_goal
                session.inbox.post(ControlMission(action="resume"), Who("Bea"))
        session.finish()
    assert seen[0] == CutOff(OnErrandOf("goal", "Ada"))
    assert at_goal is not None
    there = at_goal.estimate
    assert abs(there.x_map_m - GOAL[0]) < 0.15 and abs(there.y_map_m - GOAL[1]) < 0.15
    assert record.status.state == "done" and record.status.rows_done == (0,)
