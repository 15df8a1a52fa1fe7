"""Robots without a magnetometer in the benchmark: the stack itself drives them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from agribot.cli.main import main
from agribot.core.geo import MapFrame
from agribot.core.pose import Pose2
from agribot.description.loader import load_robot
from agribot.lab.bench.nav.plant import RoverFleet
from agribot.lab.bench.nav.preset_receivers import PresetReceivers
from agribot.lab.bench.nav.scenario import (
    DT_S,
    HEADLAND_M,
    Preset,
    Scenario,
    SoilDrift,
    scenario,
)
from agribot.lab.bench.nav.stack_missions import run_stack_missions
from tests import nightly

MODULES = ("judge", "row_camera", "scenario", "stack_missions", "table")


def plan(receiver: Preset, *, vision: bool) -> Scenario:
    return scenario(receiver, vision=vision, speed_mps=0.8, variant="nominal")


@pytest.fixture
def one_row(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in MODULES:
        monkeypatch.setattr(f"agribot.lab.bench.nav.{module}.ROWS", 1)


def test_the_fixes_of_a_preset_are_those_of_the_antenna_of_its_rover_and_come_late() -> None:
    plant, robot = RoverFleet((1, 2), SoilDrift()), load_robot()
    receivers = PresetReceivers((1, 2), plan("rtk-1", vision=False), robot)
    frame = MapFrame(plan("rtk-1", vision=False).field().datum)
    lever_m = robot.body_from_link(robot.gnss.link)[:2, 3].tolist()
    for k in range(1, 31):
        receivers.step(k, plant)
    assert receivers.take(0.19) == [[], []]  # sampled at 0.1 s, 0.1 s late
    both = receivers.take(1.0)
    assert [len(fixes) for fixes in both] == [3, 3]
    for fixes, y_m, yaw_rad in zip(both, plant.y_m, plant.yaw_rad, strict=True):
        first = fixes[0]
        assert first.t_s == pytest.approx(10 * DT_S)
        seen_m = frame.map_from_geodetic(first.lat_deg, first.lon_deg, first.alt_m)
        expected_m = Pose2(-HEADLAND_M, y_m, yaw_rad).transform(*lever_m)
        assert np.hypot(*np.subtract(seen_m[:2], expected_m)) < 0.05


@pytest.mark.usefixtures("one_row")
def test_a_row_is_driven_without_a_magnetometer(capsys: pytest.CaptureFixture[str]) -> None:
    status = main(
        ["bench", "nav", "--sensors", "rtk-1", "--no-vision", "--seeds", "20000", "--workers", "1",
         "--json", "--integrity"]
    )  # fmt: skip
    (entry,) = json.loads(capsys.readouterr().out.strip().splitlines()[-1])["lines"]
    assert status == 0
    assert entry["missions_ok"] == 1 and entry["crushed"] == 0
    assert entry["xte_rms_m"] < 0.04
    assert entry["nees_lateral"] is not None and entry["nees_lateral"] < 6.0
    assert entry["level"]["row_km"] == pytest.approx(0.012, rel=0.1)


@nightly.by_day(
    "test_a_row_is_driven_without_a_magnetometer",
    "tests/autonomy/plan/test_caution.py::"
    "test_far_above_the_limit_it_stands_at_once_unless_a_person_bids_it_creep_on",
)
@pytest.mark.parametrize("receiver", ["m8n-urban", "m8n-1"])
def test_without_a_camera_a_cheap_receiver_stands_before_it_crushes_the_crop(
    receiver: Preset,
) -> None:
    (outcome,) = run_stack_missions((20000,), plan(receiver, vision=False), load_robot())
    assert not outcome.finished
    assert outcome.crushed == 0


def test_the_original_robot_has_no_heading_without_a_magnetometer(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["bench", "nav", "--sensors", "rtk-1", "--seeds", "1", "--baseline"]) == 2
    assert "--baseline: the original robot needs a magnetometer" in capsys.readouterr().err
