"""Every weed that was left says why."""

from __future__ import annotations

import math

import pytest

from agribot.autonomy.implements.treatment import Treatment
from agribot.core.config import TreatmentConfig
from agribot.core.implement.left_weeds import ENDED_BY_OPERATOR, PASSED, Passage, count_left
from agribot.core.messages import Row
from agribot.description.loader import load_robot
from tests.autonomy.implements.looks import POSE
from tests.autonomy.implements.spray_ground import BOOM, Field, drive_over, make_map
from tests.autonomy.weeds.weed_field import make_estimate, make_plant, make_scene

Place = tuple[float, float]


def find_reason(
    weed: Place, crop: Place | None = None, *, tool_on: bool = True, latency_s: float = 0.1
) -> str:
    """Drive over a weed and ask the map why it was left."""
    weed_map = make_map([weed], [] if crop is None else [crop])
    field = Field(latency_s=latency_s)
    drive_over(Treatment(TreatmentConfig(), BOOM), weed_map, field, tool_on=tool_on)
    (found,) = weed_map.weeds()
    return found.left


@pytest.mark.parametrize(
    ("weed", "crop", "reason"),
    [
        ((1.0, 0.0), (1.0, 0.06), "beside a crop"),
        ((1.0, 0.02), (1.0, 0.12), "stem of crop"),
        ((1.0, 0.41), None, "outside the tool"),
        ((1.0, 0.2), None, ""),
        ((9.0, 0.2), None, ""),
    ],
    ids=["in the guard", "stem under the nozzle", "beside the boom", "treated", "not come to"],
)
def test_a_weed_that_is_left_says_what_kept_the_tool_off(
    weed: Place, crop: Place | None, reason: str
) -> None:
    assert find_reason(weed, crop) == reason


def test_a_tool_that_is_off_is_a_reason_until_it_comes_again() -> None:
    weed_map = make_map([(1.0, 0.2)])
    treatment = Treatment(TreatmentConfig(), BOOM)
    drive_over(treatment, weed_map, Field(), tool_on=False)
    assert [weed.left for weed in weed_map.weeds()] == ["tool off"]
    drive_over(treatment, weed_map, Field(), from_s=30.0)
    (weed,) = weed_map.weeds()
    assert weed.treated_s is not None and weed.left == ""


def test_a_weed_that_is_sure_only_after_the_tool_was_over_it_came_too_late() -> None:
    place = (1.0, 0.2)
    weed_map = make_map([])
    weed_map.add(make_scene(0.0, (make_plant(*place),), view=()), POSE)
    drive_over(Treatment(TreatmentConfig(), BOOM), weed_map, Field(), from_s=1.0)
    for t_s in (10.0, 10.1, 10.2, 10.3):
        weed_map.add(make_scene(t_s, (make_plant(*place),), view=()), POSE)
    assert [weed.left for weed in weed_map.weeds()] == ["seen too late"]


def test_reasons_are_counted_of_weeds_that_were_not_treated() -> None:
    weed_map = make_map([(1.0, 0.2), (1.3, 0.41), (1.6, 0.41), (9.0, 0.0)])
    drive_over(Treatment(TreatmentConfig(), BOOM), weed_map, Field())
    row = Row(index=0, start_map_m=(0.0, 0.0), end_map_m=(10.0, 0.0))
    passage = Passage((row,), lambda _row, along_m: along_m < 5.0, 0.8, ENDED_BY_OPERATOR)
    counts = count_left(weed_map.weeds(), passage)
    assert counts == {"outside the tool": 2, "run ended by the operator": 1}
    assert list(counts) == ["outside the tool", "run ended by the operator"]


def test_a_weed_that_a_tool_without_reasons_passed_is_counted_as_passed() -> None:
    row = Row(index=0, start_map_m=(0.0, 0.0), end_map_m=(10.0, 0.0))
    passage = Passage((row,), lambda _row, _along_m: True, 0.8, ENDED_BY_OPERATOR)
    assert count_left(make_map([(1.0, 0.2)]).weeds(), passage) == {PASSED: 1}


@pytest.mark.parametrize("robot", ["agribot", "agribot-point"])
def test_a_robot_that_does_not_know_where_it_is_does_nothing_and_blames_nothing(robot: str) -> None:
    weed_map = make_map([(1.0, 0.2)])
    treatment = Treatment(TreatmentConfig(), load_robot(robot).implement)
    lost = make_estimate(10.0, math.nan, math.nan, math.nan, ok=False)
    assert not any(treatment.step(lost, weed_map, True).sections_on)
    assert [weed.left for weed in weed_map.weeds()] == [""]
