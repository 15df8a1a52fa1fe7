"""A person sets the robot's pose: accepted at rest, recorded, replayed."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from agribot.app.simulated_run import SimulatedRun, simulate
from agribot.cli.main import main
from agribot.core import config
from agribot.core.messages import ControlMission, CorrectPose, Estimate

SETTINGS = ["perception.enabled=false", "seed=1", "duration_s=14"]
AT_REST_S, MOVING_S = 8.0, 10.0
STDS = (0.3, 0.1)


def estimates(session: SimulatedRun, at_s: float, shift_m: float) -> list[Estimate]:
    """Estimates of the tick before a pose `shift_m` off is set, and of that tick."""
    seen: list[Estimate] = []
    inbox = session.inbox
    for record in session.ticks():
        now_s = round(record.batch.t_s, 2)
        if at_s == AT_REST_S and now_s == AT_REST_S - 2.0:
            inbox.post(ControlMission(action="pause"))
        if now_s == at_s:
            here = record.estimate
            x_m, std_m, std_rad = here.x_map_m + shift_m, *STDS
            pose = CorrectPose(
                x_map_m=x_m, y_map_m=here.y_map_m, yaw_map_rad=here.yaw_map_rad,
                std_m=std_m, std_rad=std_rad,
            )  # fmt: skip
            inbox.post(pose)
        if at_s <= now_s < at_s + 0.03:
            seen.append(record.estimate)
    return seen


def test_a_robot_at_rest_believes_it_and_then_its_sensors_and_a_replay_repeats_it(
    tmp_path: Path,
) -> None:
    with simulate(config.load("farm", SETTINGS), tmp_path / "run") as session:
        before, after = estimates(session, AT_REST_S, shift_m=0.2)
        session.finish()
        last = session.last
        log = [event.reason for event in session.event_log.events]
    assert after.x_map_m - before.x_map_m == pytest.approx(0.2, abs=0.02)
    assert after.pos_std_m == pytest.approx(STDS[0], abs=0.05)
    assert after.yaw_std_rad == pytest.approx(STDS[1], abs=0.02)
    assert last is not None
    assert math.dist((last.estimate.x_map_m, last.estimate.y_map_m),
                     (before.x_map_m, before.y_map_m)) < 0.1  # fmt: skip
    assert any(reason.startswith("pose_estimate ") for reason in log)
    assert main(["replay", str(tmp_path / "run" / "run.mcap")]) == 0


def test_a_robot_that_drives_believes_its_sensors(tmp_path: Path) -> None:
    with simulate(config.load("farm", SETTINGS), tmp_path / "run") as session:
        before, after = estimates(session, MOVING_S, shift_m=5.0)
        assert session.stack.localizer.rejected["pose by hand"] == 1
    assert abs(after.x_map_m - before.x_map_m) < 0.05
