"""Blades between the crop: decided by the hoe, judged by the simulator's soil."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from agribot.autonomy.implements.treatment import Treatment
from agribot.autonomy.weeds.map import WeedMap
from agribot.core.config import LeafRule, TreatmentConfig, WeedConfig
from agribot.core.errors import ConfigError
from agribot.core.geo import Datum
from agribot.core.implement.hoe import HoeSpec
from agribot.core.messages import FloatArray, ImplementCommand, PlantClass
from agribot.core.world import Plant, WorldSpec
from agribot.sim.implements.hoe import HoeEffect
from agribot.sim.state import HISTORY_COLUMNS, VELOCITY
from tests import nightly
from tests.autonomy.implements.looks import closed_row, seen_on_the_way
from tests.autonomy.implements.spray_ground import figure
from tests.autonomy.weeds.weed_field import make_estimate

HOE = HoeSpec(
    x_body_m=-0.35, section_count=9, section_spacing_m=0.1, section_width_m=0.09, latency_s=0.05,
    lift_m=0.05, depth_m=0.02, stroke_s=0.25, draught_npm2=750.0,
)  # fmt: skip
TICK_S = 0.02
BASE_M = 0.28
STEMS_M = [(0.9 + 0.5 * i, 0.0) for i in range(4)]
WEEDS_M = [(0.65, 0.01), (1.0, 0.2), (1.4, -0.3), (1.65, 0.02), (2.0, 0.38), (2.1, -0.21)]


def bare(x_m: float, y_m: float) -> bool:
    return False


def plant(place_m: tuple[float, float], kind: PlantClass) -> Plant:
    return Plant(
        species="x", plant=kind, x_map_m=place_m[0], y_map_m=place_m[1], yaw_rad=0.0, size_m=0.1,
        seed=0, stem_radius_m=0.01,
    )  # fmt: skip


class Ground:
    """True plants under the blades; crops come first in the world."""

    def __init__(
        self, crops_m: Sequence[tuple[float, float]], weeds_m: Sequence[tuple[float, float]] = ()
    ) -> None:
        plants = [plant(at_m, PlantClass.CROP) for at_m in crops_m]
        plants += [plant(at_m, PlantClass.WEED) for at_m in weeds_m]
        world = WorldSpec(name="x", datum=Datum(lat_deg=0.0, lon_deg=0.0), plants=tuple(plants))
        self.crop_count = len(crops_m)
        self.effect = HoeEffect(HOE, world, BASE_M)

    def step(
        self, t_s: float, pose: tuple[float, float, float], v_mps: float, command: ImplementCommand
    ) -> None:
        """The robot goes straight on from its pose for one tick."""
        x, y, yaw = pose
        way_m = v_mps * TICK_S
        after = _row(x + way_m * math.cos(yaw), y + way_m * math.sin(yaw), yaw, v_mps)
        self.effect.command(t_s, command)
        self.effect.update(t_s + TICK_S, _row(x, y, yaw, v_mps), after, TICK_S)

    @property
    def crops_cut(self) -> set[int]:
        return {index for index in self.effect.treated if index < self.crop_count}

    @property
    def weeds_uprooted(self) -> set[int]:
        treated = self.effect.treated
        return {index - self.crop_count for index in treated if index >= self.crop_count}


def _row(x_m: float, y_m: float, yaw_rad: float, v_mps: float) -> FloatArray:
    row = np.zeros(HISTORY_COLUMNS)
    row[:7] = x_m, y_m, BASE_M, math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)
    row[VELOCITY] = v_mps * math.cos(yaw_rad), v_mps * math.sin(yaw_rad), 0.0
    return row


def hoe_along(
    treatment: Treatment,
    weed_map: WeedMap,
    ground: Ground,
    *,
    v_mps: float = 0.4,
    way_m: float = 3.2,
    yaw_rate_radps: float = 0.0,
    pos_std_m: float = 0.01,
) -> list[ImplementCommand]:
    x, y, yaw = 0.0, 0.0, 0.0
    commands = []
    for tick in range(round(way_m / v_mps / TICK_S)):
        t_s = 20.0 + tick * TICK_S
        estimate = make_estimate(
            t_s, x, y, yaw, v_mps=v_mps, yaw_rate_radps=yaw_rate_radps, pos_std_m=pos_std_m
        )
        commands.append(treatment.step(estimate, weed_map, True))
        ground.step(t_s, (x, y, yaw), v_mps, commands[-1])
        x, y = x + v_mps * TICK_S * math.cos(yaw), y + v_mps * TICK_S * math.sin(yaw)
        yaw += yaw_rate_radps * TICK_S
    return commands


@nightly.one_by_one("v_mps", (0.4, 0.8, 0.15), in_suite=2)
def test_weeds_beside_and_between_the_crop_are_uprooted_and_no_crop_is_cut(v_mps: float) -> None:
    weed_map = seen_on_the_way(WEEDS_M, bare, STEMS_M)
    ground, treatment = Ground(STEMS_M, WEEDS_M), Treatment(TreatmentConfig(), HOE)
    hoe_along(treatment, weed_map, ground, v_mps=v_mps)
    assert not ground.crops_cut
    beside = {index for index, (_, y_m) in enumerate(WEEDS_M) if abs(y_m) > 0.15}
    assert beside <= ground.weeds_uprooted
    if v_mps < 0.5:  # faster, the blades have no time to come down between the plants
        assert len(ground.weeds_uprooted) == len(WEEDS_M)


def test_without_the_crop_in_the_map_the_same_blades_would_cut_it() -> None:
    """Guards the test above: it is the map that lifts them."""
    ground = Ground(STEMS_M)
    hoe_along(Treatment(TreatmentConfig(), HOE), seen_on_the_way([], bare), ground)
    assert ground.crops_cut == {0, 1, 2, 3}


def test_a_crop_that_is_not_confirmed_yet_is_spared_too() -> None:
    weed_map = seen_on_the_way([], bare, STEMS_M)
    for track in weed_map.tracks:
        track.is_confirmed = False
    ground = Ground(STEMS_M)
    hoe_along(Treatment(TreatmentConfig(), HOE), weed_map, ground)
    assert not ground.crops_cut


def test_blades_stay_up_over_ground_that_no_frame_has_shown() -> None:
    ground, treatment = Ground([], WEEDS_M), Treatment(TreatmentConfig(), HOE)
    commands = hoe_along(treatment, WeedMap(WeedConfig()), ground)
    assert not any(command.is_on for command in commands)
    assert figure(treatment, "passed") > 0.0 == figure(treatment, "hoed")


def test_over_leaves_that_close_to_one_row_no_blade_goes_down_and_beside_them_all_do() -> None:
    stems = [(0.9 + 0.18 * i, 0.0) for i in range(9)]
    ground, treatment = Ground(stems), Treatment(TreatmentConfig(), HOE)
    weed_map = seen_on_the_way([], closed_row)
    assert not weed_map.crops()
    commands = hoe_along(treatment, weed_map, ground)
    assert not ground.crops_cut
    downs = np.array([command.sections_on for command in commands]).sum(axis=0)
    assert not downs[3:6].any() and (downs[[0, 1, 7, 8]] > 100).all()


def test_what_a_cheap_receiver_is_off_by_lifts_no_blade() -> None:
    """Plants and blades share it: the robot saw the plants itself."""

    def hoe(pos_std_m: float) -> list[ImplementCommand]:
        treatment = Treatment(TreatmentConfig(), HOE)
        weed_map = seen_on_the_way(WEEDS_M, bare, STEMS_M)
        return hoe_along(treatment, weed_map, Ground(STEMS_M), pos_std_m=pos_std_m)

    assert hoe(1.5) == hoe(0.01)


@pytest.mark.parametrize(("leaves", "is_hoed"), [("alone", False), ("rows", True)])
def test_leaves_beside_a_row_are_hoed_under_where_the_settings_allow_it(
    leaves: LeafRule, is_hoed: bool
) -> None:
    stems = [(0.6 + 0.25 * i, 0.0) for i in range(11)]
    weed_map = seen_on_the_way([], lambda _x, y: abs(y) <= 0.25, stems, points=True)
    ground = Ground(stems, [(1.6, 0.2)])
    hoe_along(Treatment(TreatmentConfig(leaves=leaves), HOE), weed_map, ground)
    assert not ground.crops_cut
    assert bool(ground.weeds_uprooted) == is_hoed


@pytest.mark.parametrize("leaves", ["alone", "mapped", "rows"])
def test_a_crop_that_the_network_took_for_its_neighbour_is_not_cut(leaves: LeafRule) -> None:
    """Its leaves point to the neighbour, behind which a gap begins in the row."""
    mapped = [(0.4 + 0.25 * i, 0.0) for i in range(6)]
    missed = (mapped[-1][0] + 0.25, 0.0)
    stems = [*mapped, missed]

    def is_crop(x_m: float, y_m: float) -> bool:
        return min(math.dist((x_m, y_m), stem) for stem in stems) <= 0.14

    weed_map = seen_on_the_way([], is_crop, mapped, points=True)
    for track in weed_map.tracks:
        track.area_m2 = 0.12  # with the leaves of the neighbour
    ground = Ground(stems, [(missed[0] + 0.35, 0.0)])
    hoe_along(Treatment(TreatmentConfig(leaves=leaves), HOE), weed_map, ground)
    assert not ground.crops_cut
    assert ground.weeds_uprooted  # behind the leaves, in the gap


def test_a_blade_keeps_farther_off_a_large_plant_whose_stem_is_thick() -> None:
    def find_first_hoed_cm(area_m2: float) -> int:
        weed_map = seen_on_the_way([], bare, [(1.0, 0.0)])
        for track in weed_map.tracks:
            track.area_m2 = area_m2
        ground = Ground([(1.0, 0.0)], [(1.0 + 0.01 * i, 0.0) for i in range(5, 40)])
        hoe_along(Treatment(TreatmentConfig(), HOE), weed_map, ground)
        return 5 + min(ground.weeds_uprooted)

    seedling, young, large = (find_first_hoed_cm(area_m2) for area_m2 in (0.002, 0.005, 0.1))
    assert seedling == young
    assert 2 <= large - seedling <= 4


def test_a_blade_is_back_in_the_soil_a_hand_behind_a_stem() -> None:
    ground = Ground([(1.0, 0.0)], [(1.0 + 0.01 * i, 0.0) for i in range(5, 40)])
    weed_map = seen_on_the_way([], bare, [(1.0, 0.0)])
    hoe_along(Treatment(TreatmentConfig(), HOE), weed_map, ground, v_mps=0.4)
    first = 5 + min(ground.weeds_uprooted)
    assert not ground.crops_cut
    assert 12 <= first <= 25  # cm: 7 of keeping off, and the way during its stroke
    assert ground.weeds_uprooted == set(range(first - 5, 35))


def test_weeds_that_are_left_say_why() -> None:
    weeds = [(1.0, 0.11), (1.5, 0.3), (2.0, -0.3), (1.5, -0.3)]
    weed_map = seen_on_the_way(weeds, lambda x, y: x < 1.9 and y > 0.2, [(1.0, 0.0)])
    treatment = Treatment(TreatmentConfig(), HOE)
    hoe_along(treatment, weed_map, Ground([(1.0, 0.0)], weeds))
    told = {(round(weed.x_map_m, 1), round(weed.y_map_m, 1)): weed for weed in weed_map.weeds()}
    assert told[1.0, 0.1].left == "stem of crop"
    assert told[1.5, 0.3].left == "leaf of crop"
    assert told[1.5, -0.3].treated_s is not None and told[1.5, -0.3].left == ""


def test_weeds_passed_while_the_tool_is_off_say_so() -> None:
    weed_map = seen_on_the_way([(1.5, 0.3)], bare)
    treatment = Treatment(TreatmentConfig(), HOE)
    for tick in range(200):
        estimate = make_estimate(20.0 + tick * TICK_S, 1.2 + 0.4 * tick * TICK_S, 0.0, 0.0)
        assert not treatment.step(estimate, weed_map, False).is_on
    assert [weed.left for weed in weed_map.weeds()] == ["tool off"]


def test_in_a_curve_the_swing_of_the_tool_is_allowed_for() -> None:
    radius_m = 0.4 / 0.15
    angles = np.arange(0.2, 0.9, 0.12)
    stems = [(radius_m * math.sin(a), radius_m * (1.0 - math.cos(a))) for a in angles]
    weed_map = seen_on_the_way([], bare, stems)
    ground = Ground(stems)
    hoe_along(Treatment(TreatmentConfig(), HOE), weed_map, ground, yaw_rate_radps=0.15)
    assert not ground.crops_cut


def test_what_the_hoe_reports_agrees_with_the_ground() -> None:
    weed_map = seen_on_the_way(WEEDS_M, bare, STEMS_M)
    ground, treatment = Ground(STEMS_M, WEEDS_M), Treatment(TreatmentConfig(), HOE)
    commands = hoe_along(treatment, weed_map, ground)
    assert figure(treatment, "hoed") == pytest.approx(ground.effect.worked_m2, rel=0.05)
    assert figure(treatment, "plants treated as weeds") == len(ground.weeds_uprooted)
    assert sum(weed.treated_s is not None for weed in weed_map.weeds()) == len(WEEDS_M)
    downs = np.array([command.sections_on for command in commands]).astype(int)
    assert figure(treatment, "blade lifts") == np.sum(np.diff(downs, axis=0) < 0)


@pytest.mark.parametrize(
    "changes", [{"ok": False}, {"v_mps": 0.05}, {"v_mps": -0.4}, {"v_mps": 0.0}]
)
def test_blades_come_up_without_a_position_at_a_crawl_and_backwards(
    changes: dict[str, float | bool],
) -> None:
    treatment, weed_map = Treatment(TreatmentConfig(), HOE), seen_on_the_way([], bare)
    estimate = make_estimate(20.0, 1.5, 0.0, 0.0)
    assert treatment.step(estimate, weed_map, True).is_on
    now = msgspec.structs.replace(estimate, t_s=20.02, **changes)
    assert treatment.step(now, weed_map, True) == ImplementCommand(sections_on=(False,) * 9)


def test_blades_work_as_deep_as_the_settings_want_and_no_deeper_than_they_reach() -> None:
    shallow = Treatment(TreatmentConfig(depth_m=0.01), HOE)
    command = shallow.step(make_estimate(20.0, 1.5, 0.0, 0.0), seen_on_the_way([], bare), True)
    assert command.setpoints == {"depth_m": 0.01}
    assert [line.text for line in HOE.describe(command)] == ["●" * 9, "1.0 cm"]
    with pytest.raises(ConfigError, match=r"reach 0\.02 m"):
        Treatment(TreatmentConfig(depth_m=0.03), HOE)
