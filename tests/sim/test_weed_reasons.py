"""Every weed that truly stands there and was not treated has a reason."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import msgspec
import pytest

from agribot.core.geo import Datum
from agribot.core.implement.left_weeds import ENDED_BY_OPERATOR, ROW_NOT_DRIVEN, Passage
from agribot.core.implement.row_shares import TreatedShare
from agribot.core.messages import MappedPlant, PlantClass, Row
from agribot.core.world import Plant, WorldSpec
from agribot.description.loader import load_robot
from agribot.sim.plant_states import PlantStates
from agribot.sim.referee import Referee
from agribot.sim.scores import ErrorSums, RefereeState, WeedScore
from agribot.sim.weed_reasons import PlantsOnMap, UntreatedWeeds

ROW = Row(index=0, start_map_m=(0.0, 0.0), end_map_m=(4.0, 0.0))
NEXT_ROW = Row(index=1, start_map_m=(0.0, 1.0), end_map_m=(4.0, 1.0))
PASSED = Passage((ROW,), lambda _row, _along_m: True, 1.08, ROW_NOT_DRIVEN)
SEEN = {0: 9}
Place = tuple[float, float]


def grow(x_m: float, y_m: float, kind: PlantClass = PlantClass.WEED) -> Plant:
    return Plant(
        species="grass", plant=kind, x_map_m=x_m, y_map_m=y_m, yaw_rad=0.0, size_m=0.1, seed=1,
    )  # fmt: skip


def mapped(x_m: float, y_m: float, left: str = "", treated_s: float | None = None) -> MappedPlant:
    return MappedPlant(
        id=1, plant=PlantClass.WEED, x_map_m=x_m, y_map_m=y_m, cov_m2=(1e-4, 0.0, 0.0, 1e-4),
        area_m2=1e-3, confidence=0.9, sightings=9, first_seen_s=0.0, last_seen_s=1.0,
        treated_s=treated_s, left=left,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("weeds", "crops", "looks", "reason"),
    [
        ([mapped(2.0, 0.3, "leaf of crop")], [], SEEN, "leaf of crop"),
        ([mapped(2.0, 0.3, treated_s=3.0)], [], SEEN, "aimed at and not hit"),
        ([mapped(2.0, 0.3)], [], SEEN, "passed by the tool"),
        ([], [mapped(2.05, 0.3)], SEEN, "called crop"),
        ([], [], {0: 1}, "never seen enough"),
        ([mapped(2.08, 0.3)], [], SEEN, "merged with a neighbour"),
        ([mapped(2.2, 0.3)], [], SEEN, "misplaced on the map"),
        ([], [], SEEN, "seen and not mapped"),
    ],
)
def test_the_map_where_a_weed_stands_is_the_reason_why_it_was_left(
    weeds: list[MappedPlant], crops: list[MappedPlant], looks: dict[int, int], reason: str
) -> None:
    """The second weed stands 9 cm farther on, and takes what is nearer to it."""
    plants = [grow(2.0, 0.3), grow(2.09, 0.3)]
    found = UntreatedWeeds(plants, PlantsOnMap(weeds, crops), PASSED, looks)
    assert found.find_reason(0) == reason


@pytest.mark.parametrize(
    ("place", "is_passed", "width_m", "reason"),
    [
        ((2.0, 0.3), True, 1.08, "passed by the tool"),
        ((2.0, 0.3), False, 1.08, "row not driven"),
        ((2.0, 0.3), True, None, "no tool on the robot"),
        ((2.0, 0.6), True, 1.08, "outside the tool"),
        ((4.1, 0.0), True, 1.08, "outside the rows"),
    ],
)
def test_a_weed_of_which_the_tool_says_nothing_is_left_by_where_it_stands(
    place: Place, is_passed: bool, width_m: float | None, reason: str
) -> None:
    passage = Passage((ROW,), lambda _row, _along_m: is_passed, width_m, ROW_NOT_DRIVEN)
    assert passage.explain(*place) == reason


def score(weeds: list[Plant], before: dict[str, Any], not_passed: str = "") -> WeedScore:
    """Score a run over the first of two rows that goes on with the state of another run."""
    world = WorldSpec(name="two rows", datum=Datum(lat_deg=52.0, lon_deg=8.0), plants=tuple(weeds))
    source: Any = SimpleNamespace(
        treated={}, worked_m2=0.0, wet_leaves={}, offsets_m={}, looks={}, crushed=set(),
        plants=PlantStates(len(weeds)), restore_plants=lambda *_: None,
    )  # fmt: skip
    referee = Referee(source, world, (ROW, NEXT_ROW), robot=load_robot("agribot"))
    state = {
        "tally": ErrorSums(), "distance_m": 0.0, "confusion": (0,) * 9, "rows": (ROW, NEXT_ROW),
        "worst_m": {}, "slices": (), "goals_map_m": (), "nearest_m": (), "crushed": (),
        "treated": (), "worked_m2": 0.0, "plants_total": len(weeds),
    }  # fmt: skip
    assert referee.restore(RefereeState(**cast(Any, state | before))) == ""
    return referee.score_weeds([], [], [0], not_passed)


def test_weeds_in_the_row_and_between_the_rows_are_counted_apart() -> None:
    """15 cm from the line of a row is the border; those of the row not driven do not count."""
    weeds = [grow(1.0, 0.02), grow(1.5, 0.14), grow(2.0, 0.16), grow(2.0, -0.4), grow(2.0, 0.98)]
    found = score(weeds, {"treated": (1, 2, 3)})
    assert found.in_row == TreatedShare(of=2, treated=1, share=0.5)
    assert found.between_rows == TreatedShare(of=2, treated=2, share=1.0)
    assert found.truth == found.in_row.of + found.between_rows.of


def test_no_weed_is_no_share() -> None:
    found = score([grow(1.0, 0.3)], {})
    assert found.in_row == TreatedShare(of=0, treated=0, share=None)


def test_a_run_that_the_operator_cut_names_that_as_the_reason_of_what_was_not_driven() -> None:
    """The robot came to 2 m: its tool, 0.35 m behind, was over the weed at 1 m alone."""
    driven = tuple((0, place) for place in range(8))
    weeds = [grow(1.0, 0.3), grow(1.9, 0.3), grow(3.0, 0.3), grow(1.0, 1.3)]
    found = score(weeds, {"slices": driven, "looks": {0: 5, 1: 5}}, ENDED_BY_OPERATOR)
    assert found.untreated == {"run ended by the operator": 3, "seen and not mapped": 1}


def test_looks_of_an_earlier_run_count() -> None:
    every = tuple((row, place) for row in (0, 1) for place in range(16))
    found = score([grow(1.0, 0.3)], {"slices": every, "looks": {0: 1}}, ROW_NOT_DRIVEN)
    assert found.untreated == {"never seen enough": 1}


def test_a_judgement_from_before_looks_were_counted_is_read() -> None:
    state = RefereeState(
        tally=ErrorSums(), distance_m=0.0, confusion=(0,) * 9, rows=(), worst_m={}, slices=(),
        goals_map_m=(), nearest_m=(), crushed=(), treated=(), worked_m2=0.0, plants_total=0,
    )  # fmt: skip
    tree = msgspec.to_builtins(state)
    del tree["looks"]
    assert msgspec.convert(tree, RefereeState) == state
