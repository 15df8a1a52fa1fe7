"""Names or rules: tools that work in one drive, by true and by the network's names."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.autonomy.perceive.stems import find_owners, find_stems
from agribot.core.config import TreatmentConfig
from agribot.core.implement.kind import Pull
from agribot.core.messages import FloatArray, ImplementCommand, PlantClass, Row
from agribot.core.world import Plant
from agribot.lab.bench import in_row
from agribot.lab.bench.in_row import BandShare
from agribot.lab.bench.true_names import make_plant_maps
from agribot.lab.train.plant_truth import PlantTruth
from tests import nightly

ROW = Row(index=0, start_map_m=(0.0, 0.0), end_map_m=(4.0, 0.0))


def test_a_network_that_makes_no_mistakes_finds_each_stem_and_leads_each_leaf_to_it() -> None:
    """A weed between two crops whose leaves touch; one crop has its stem beside the picture."""
    number = np.zeros((48, 64), dtype=np.uint16)
    number[8:24, 4:28], number[8:24, 28:40], number[8:24, 40:64] = 1, 2, 3
    stem_px = np.array([(14.3, 16.7), (33.0, 18.2), (70.0, 16.0)])
    kind = np.array([PlantClass.CROP, PlantClass.WEED, PlantClass.CROP], dtype=np.uint8)
    maps = make_plant_maps(PlantTruth(number, stem_px, kind))
    stems = find_stems(maps, 0.5)
    order = np.argsort(stems.uv_px[:, 0])
    assert stems.uv_px[order] == pytest.approx(stem_px[:2])
    assert stems.kind_scores[order].tolist() == [[0.0, 1.0], [1.0, 0.0]]
    owners = find_owners(maps, stems, number > 0)
    assert (owners[number == 1] == order[0]).all() and (owners[number == 2] == order[1]).all()
    assert (owners[number == 3] == -1).mean() > 0.9


class Effect:
    """What a tool did: it met plants 1, 2 and 5, and wet half of the leaves of one crop."""

    worked_m2 = 0.4

    def __init__(self) -> None:
        self.treated = {1: 3.0, 2: 4.0, 5: 5.0}
        self.wet_leaves = {5: 0.5}
        self.offsets_m: dict[int, float] = {}

    def command(self, t_s: float, command: ImplementCommand) -> None: ...

    def update(self, t_s: float, before: FloatArray, after: FloatArray, dt_s: float) -> None: ...

    def pull(self) -> Pull | None:
        return None


def grow(x_m: float, y_m: float, kind: PlantClass) -> Plant:
    return Plant(
        species="grass", plant=kind, x_map_m=x_m, y_map_m=y_m, yaw_rad=0.0, size_m=0.1, seed=1
    )


def test_weeds_are_counted_by_their_distance_from_the_line_of_the_row() -> None:
    places = [(1.0, 0.04), (1.0, 0.07), (2.0, -0.3), (2.0, 0.6), (4.2, 0.0)]
    plants = [grow(x, y, PlantClass.WEED) for x, y in places]
    plants += [grow(3.0, 0.0, PlantClass.CROP), grow(3.3, 0.0, PlantClass.CROP)]
    found = in_row.describe(("shipped", "over leaves"), Effect(), plants, (ROW,))
    assert found.bands == (BandShare(0, 1), BandShare(1, 1), BandShare(0, 0), BandShare(1, 1))
    assert (found.treated, found.weeds) == (2, 3)
    assert (found.crops_hit, found.crops) == (1, 2)
    assert found.sprayed_ratio == pytest.approx(0.1)
    assert found.crop_leaves_wet_ratio == pytest.approx(0.25)
    (twice,) = in_row.pool([found, found])
    assert (twice.treated, twice.weeds, twice.bands[1]) == (4, 6, BandShare(2, 2))
    assert "0 of 2" in in_row.format_table([twice]) and "10.0 %" in in_row.format_table([twice])


def test_both_networks_work_by_every_rule_and_the_first_is_as_shipped() -> None:
    shipped = TreatmentConfig(margin_m=0.08)
    varied = in_row.vary_treatment(shipped)
    assert len(varied) == 2 * len(in_row.RULES)
    assert varied["shipped", "shipped"] == varied["true", "shipped"] == shipped
    assert varied["true", "4 cm, over leaves"].leaves == "any"


@nightly.by_day(
    "test_weeds_are_counted_by_their_distance_from_the_line_of_the_row",
    "test_a_network_that_makes_no_mistakes_finds_each_stem_and_leads_each_leaf_to_it",
)
def test_names_and_rules_together_treat_more_weeds_of_a_row_than_either() -> None:
    outcomes = {(found.names, found.rule): found for found in in_row.drive_row(1, 12.0)}
    shipped, best = outcomes["shipped", "shipped"], outcomes["true", "4 cm, over leaves"]
    assert shipped.crops_hit == 0
    assert best.treated > outcomes["shipped", "4 cm, over leaves"].treated > shipped.treated
    assert best.treated > outcomes["true", "shipped"].treated
