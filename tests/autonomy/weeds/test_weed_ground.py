"""Ground on which weeds are suspected: what many looks make of it."""

from __future__ import annotations

import msgspec
import pytest

from agribot.autonomy.weeds.map import WeedMap
from agribot.core.config import WeedConfig
from agribot.core.implement.plants import GroundBox
from agribot.core.pose import Pose2
from tests.autonomy.implements.looks import POSE, score_weeds
from tests.autonomy.weeds.weed_field import make_estimate, make_scene

PLACE_M = (0.91, 0.21)
TICK_S = 0.02


def look(*scores: float) -> WeedMap:
    """The map after looks from one place, each with this confidence in a weed at `PLACE_M`."""
    weed_map = WeedMap(WeedConfig())
    for number, score in enumerate(scores):
        weed_map.track_pose(make_estimate(TICK_S * number, 0.0, 0.0, 0.0, v_mps=0.0))
        scene = make_scene(TICK_S * number, (), view=())
        seen = score_weeds(POSE, {PLACE_M: score})
        weed_map.add(msgspec.structs.replace(scene, weed_scores=seen))
    return weed_map


def find_scores(weed_map: WeedMap, x_m: float, *left_m: float, yaw_rad: float = 0.0) -> list[float]:
    box = GroundBox(Pose2(x_m, 0.0, yaw_rad), 0.02, 0.02)
    scores: list[float] = weed_map.weed_ground.find_scores(box, left_m).tolist()
    return scores


def test_a_place_scores_the_mean_of_all_looks_at_it() -> None:
    aside, there = find_scores(look(0.6, 0.0, 0.1, 0.1), 0.91, -0.2, 0.21)
    assert there == pytest.approx(0.2, abs=0.01)
    assert aside < 0.01


def test_ground_that_was_looked_at_less_than_three_times_or_never_scores_nothing() -> None:
    assert find_scores(look(0.9, 0.9), 0.91, 0.21) == [0.0]
    assert find_scores(look(0.9, 0.9, 0.9), -3.0, 0.21) == [0.0]


def test_suspected_ground_follows_the_corrections_of_the_pose() -> None:
    weed_map = look(0.4, 0.4, 0.4)
    weed_map.track_pose(make_estimate(0.06, 0.5, -0.4, 0.3, v_mps=0.0))
    x_m, y_m = Pose2(0.5, -0.4, 0.3).transform(*PLACE_M)
    ground = weed_map.weed_ground
    assert ground.find_scores(GroundBox(Pose2(x_m, y_m, 0.3), 0.02, 0.02), (0.0,))[
        0
    ] == pytest.approx(0.4, abs=0.01)
    assert find_scores(weed_map, *PLACE_M)[0] < 0.01
