"""Encounters are counted by what touched, at which speed, and what the robot waited for."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from agribot.cli.main import main
from agribot.core.encounter import Encounter
from agribot.core.errors import ConfigError
from agribot.lab.bench import encounters
from agribot.record.report import MissionReport, Report, SafetyEvent, SafetyReport

PLAIN = Encounter(
    figure="dog", begin_s=20.0, end_s=30.0, ahead_m=1.5, speed_mps=1.0, stays_s=4.0, robot_mps=0.4,
    nearest_m=1.2, stood_m=1.2,
)  # fmt: skip


def visit(**changes: Any) -> Encounter:
    return msgspec.structs.replace(PLAIN, **changes)


def drive(*visits: Encounter, waits_s: tuple[float, ...] = ()) -> Report:
    gate = tuple(SafetyEvent(t_s=t_s, reason="", code="obstacle_in_way") for t_s in waits_s)
    other = SafetyEvent(t_s=99.0, reason="", code="touched")
    base = Report(profile="x", seed=0, sensors="rtk", version="0", ok=True, reason="")
    return msgspec.structs.replace(
        base, mission=msgspec.structs.replace(base.mission, distance_m=250.0),
        safety=SafetyReport(gate=(*gate, other), visits=visits),
    )  # fmt: skip


def test_only_a_moving_robot_touches_and_only_one_that_drove_met_somebody() -> None:
    assert isinstance(drive().mission, MissionReport)
    reports = [
        drive(visit(), visit(touched_mps=0.35, touched_ahead_m=0.6, ahead_m=0.4, stood_m=0.0)),
        drive(visit(touched_mps=0.0, stood_m=0.8), visit(robot_mps=0.0, touched_mps=0.5)),
    ]
    result = encounters.summarise(reports)
    assert (result["encounters"], result["touched"], result["touched_mps_max"]) == (3, 1, 0.35)
    assert result["ran_into_standing_robot"] == 1
    assert (result["stood"], result["stood_m_min"], result["stood_m_median"]) == (3, 0.0, 0.8)
    near, *_, far = result["by_place"]
    assert near == {"from_m": 0.3, "to_m": 0.6, "encounters": 1, "touched": 1}
    assert (far["from_m"], far["encounters"]) == (2.0, 0)
    assert result["by_figure"]["dog"] == {"encounters": 3, "touched": 1}
    assert "| 0.3 to 0.6 m | 1 | 1 |" in encounters.format_table(result)
    assert "1 touched by the moving robot (at 0.35 m/s at most)" in encounters.describe_result(
        result
    )


def test_a_wait_while_somebody_is_there_is_none_for_nothing() -> None:
    seen = drive(visit(), waits_s=(22.0, 31.0, 40.0))
    assert encounters.count_false_waits(seen) == 1
    result = encounters.summarise([seen, drive()])
    assert (result["false_waits"], result["km"]) == (1, 0.5)
    assert result["false_waits_per_km"] == pytest.approx(2.0)


def test_every_seed_is_driven_at_every_speed_with_or_without_a_lidar() -> None:
    jobs = encounters.list_jobs("3-4", [0.4, 0.6], has_lidar=False)
    assert [job.name for job in jobs] == ["3-0.4", "3-0.6", "4-0.4", "4-0.6"]
    config = jobs[1].config()
    assert (config.seed, config.mission.speed_mps, config.sim.lidar) == (3, 0.6, False)
    assert config.sim.visitors == encounters.VISITORS
    with pytest.raises(ConfigError, match=r"mission\.speed_mps"):
        encounters.list_jobs("1", [9.0], has_lidar=True)


def test_a_speed_that_is_no_number_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "encounters", "--speeds", "fast"]) == 2
    assert "--speeds fast: not numbers" in capsys.readouterr().err
