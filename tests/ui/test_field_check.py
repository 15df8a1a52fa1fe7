"""The page's check of a field takes what the planner takes, and refuses what it refuses."""

from __future__ import annotations

from typing import Any

import pytest

from agribot.core.errors import MissionError
from agribot.gis.field_file import parse_field
from agribot.gis.geojson import parse_features
from agribot.ui.server.field_check import check_field
from tests.gis.test_field_file import AS_DRAWN, BAD, HERE, area_m2


@pytest.mark.parametrize("name", AS_DRAWN)
def test_a_field_as_people_draw_it_is_good_and_as_large_as_the_ground_to_be_planned(
    name: str,
) -> None:
    tree, ground_m2 = AS_DRAWN[name]
    reply = check_field(tree, HERE)
    assert reply.ok, reply.reasons
    assert reply.area_m2 == pytest.approx(ground_m2, abs=0.2)
    area, _ = parse_field(parse_features(tree, "f"), "f", HERE)
    assert area_m2(area) == pytest.approx(reply.area_m2, abs=0.2)


@pytest.mark.parametrize("name", ["crossing", "hole outside", "row outside", "row in pond"])
def test_a_field_that_the_planner_refuses_is_no_good_here_either(name: str) -> None:
    tree: Any = BAD[name][0]
    reply = check_field(tree, HERE)
    assert not reply.ok and reply.reasons
    with pytest.raises(MissionError):
        parse_field(parse_features(tree, "f"), "f", HERE)
