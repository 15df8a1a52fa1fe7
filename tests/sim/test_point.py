"""The point tool: what its heads burn, and what its mind makes them do."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from agribot.autonomy.implements.treatment import Treatment
from agribot.autonomy.weeds.map import WeedMap
from agribot.core.config import TreatmentConfig, WeedConfig
from agribot.core.errors import PlatformError
from agribot.core.implement.point import PointSpec, name_aim
from agribot.core.messages import FloatArray, ImplementCommand, PlantClass
from agribot.core.world import Plant, WorldSpec
from agribot.description.loader import load_robot
from agribot.sim.implements.point import PointEffect
from agribot.sim.state import HISTORY_COLUMNS
from tests.autonomy.weeds.weed_field import add_sightings, make_estimate

HEIGHT_M, TICK_S = 0.28, 0.02
POINT = PointSpec(
    x_body_m=-0.3, section_count=3, section_spacing_m=0.36, section_width_m=0.36, latency_s=0.06,
    reach_m=0.15, spot_radius_m=0.01, dwell_s=0.2, aim_speed_mps=3.0, recharge_s=0.1,
)  # fmt: skip
Place = tuple[float, float]


def _plant(place: Place, kind: PlantClass) -> Plant:
    return Plant(
        species="sugar_beet" if kind == PlantClass.CROP else "goosefoot", plant=kind,
        x_map_m=place[0], y_map_m=place[1], yaw_rad=0.0, size_m=0.1, seed=1, stem_radius_m=0.01,
    )  # fmt: skip


def _at(x_m: float) -> FloatArray:
    row = np.zeros(HISTORY_COLUMNS)
    row[:4] = x_m, 0.0, HEIGHT_M, 1.0
    return row


def _field(
    world: WorldSpec, weeds: Sequence[Place], crops: Sequence[Place] = ()
) -> tuple[PointEffect, WeedMap]:
    """A tool over a field, first weeds, then crops; and a map that knows all of it."""
    plants = [_plant(place, PlantClass.WEED) for place in weeds]
    plants += [_plant(place, PlantClass.CROP) for place in crops]
    effect = PointEffect(POINT, msgspec.structs.replace(world, plants=tuple(plants)), HEIGHT_M)
    weed_map = WeedMap(WeedConfig())
    add_sightings(weed_map, weeds, crops)
    return effect, weed_map


def _drive(effect: PointEffect, weed_map: WeedMap, v_mps: float = 0.4) -> Treatment:
    treatment = Treatment(TreatmentConfig(), POINT)
    for tick in range(round(3.0 / v_mps / TICK_S)):
        t_s, x_m = 10.0 + tick * TICK_S, tick * TICK_S * v_mps
        estimate = make_estimate(t_s, x_m, 0.0, 0.0, v_mps=v_mps)
        effect.command(t_s, treatment.step(estimate, weed_map, True))
        effect.update(t_s + TICK_S, _at(x_m), _at(x_m + TICK_S * v_mps), TICK_S)
    return treatment


@pytest.mark.parametrize("v_mps", [0.2, 0.5])
def test_weeds_apart_are_burnt_on_the_move_and_the_map_knows_it(
    meadow: WorldSpec, v_mps: float
) -> None:
    weeds = [(1.0, 0.0), (1.0, 0.3), (1.5, -0.4), (1.9, 0.1)]
    effect, weed_map = _field(meadow, weeds)
    treatment = _drive(effect, weed_map, v_mps)
    assert set(effect.treated) == set(range(len(weeds)))
    assert all(weed.treated_s is not None for weed in weed_map.weeds())
    lines = {line.name: line.value for line in treatment.report()}
    assert lines == {"plants treated as weeds": 4, "shots": 4}
    assert effect.worked_m2 == pytest.approx(4 * math.pi * 0.01**2)


def test_a_weed_close_to_a_crop_is_burnt_and_one_beside_its_stem_is_left(
    meadow: WorldSpec,
) -> None:
    effect, weed_map = _field(meadow, [(1.0, 0.09), (1.6, 0.05)], [(1.0, 0.0), (1.6, 0.0)])
    _drive(effect, weed_map)
    assert set(effect.treated) == {0}
    assert [weed.left for weed in weed_map.weeds()] == ["", "beside a crop"]


def test_without_the_crop_in_the_map_its_heart_would_be_burnt(meadow: WorldSpec) -> None:
    """Guards the test above: it is the guard that keeps the crop cool."""
    effect, _ = _field(meadow, [(1.6, 0.025)], [(1.6, 0.0)])
    weed_map = WeedMap(WeedConfig())
    add_sightings(weed_map, [(1.6, 0.025)], [])
    _drive(effect, weed_map)
    assert set(effect.treated) == {0, 1}


def test_more_weeds_than_a_head_has_time_for_are_left_and_say_so(meadow: WorldSpec) -> None:
    weeds = [(1.0 + 0.02 * (i % 5), -0.12 + 0.06 * (i // 5)) for i in range(20)]
    effect, weed_map = _field(meadow, weeds)
    _drive(effect, weed_map, 0.5)
    burnt = {weed.id for weed in weed_map.weeds() if weed.treated_s is not None}
    assert 1 <= len(burnt) < len(weed_map.weeds())
    assert {weed.left for weed in weed_map.weeds()} == {"", "tool busy"}


def _shine(effect: PointEffect, aim: Place, seconds: float, *, head: int = 1) -> None:
    """Hold a spot still, at the middle of a robot that stands at 0.3 m."""
    names = name_aim(head)
    on = tuple(index == head for index in range(3))
    command = ImplementCommand(sections_on=on, setpoints=dict(zip(names, aim, strict=True)))
    effect.command(0.0, command)
    for tick in range(round(seconds / TICK_S)):
        effect.update((tick + 1) * TICK_S, _at(0.3), _at(0.3), TICK_S)


def test_a_weed_dies_after_the_dwell_time_and_not_before(meadow: WorldSpec) -> None:
    effect, _ = _field(meadow, [(0.0, 0.0)])
    _shine(effect, (0.0, 0.0), 0.06 + 0.18)
    assert not effect.treated
    effect, _ = _field(meadow, [(0.0, 0.0)])
    _shine(effect, (0.0, 0.0), 0.06 + 0.22)
    assert set(effect.treated) == {0}


def test_a_spot_burns_what_is_inside_it_alone_and_crop_at_once(meadow: WorldSpec) -> None:
    effect, _ = _field(meadow, [(0.0, 0.012)], [(0.029, 0.0), (0.0, -0.031)])
    _shine(effect, (0.0, 0.0), 0.06 + 0.04)
    assert set(effect.treated) == {1}
    effect, _ = _field(meadow, [(0.0, 0.012)])
    _shine(effect, (0.0, 0.0), 1.0)
    assert not effect.treated


def test_an_aim_takes_its_time(meadow: WorldSpec) -> None:
    """15 cm at 3 m/s are a twentieth of a second."""
    for seconds, burnt in ((0.02, set()), (0.08, {0})):
        effect, _ = _field(meadow, [], [(0.0, 0.15)])
        _shine(effect, (0.0, 0.15), 0.06 + seconds)
        assert set(effect.treated) == burnt


def test_an_aim_out_of_reach_is_refused(meadow: WorldSpec) -> None:
    effect, _ = _field(meadow, [])
    with pytest.raises(PlatformError, match=r"head 2: aim 0.300 m ahead.*reaches 0.15 m"):
        _shine(effect, (0.3, 0.0), 0.02)


def test_the_packaged_robot_carries_a_point_tool() -> None:
    robot = load_robot("agribot-point")
    spec = robot.implement
    assert isinstance(spec, PointSpec)
    assert spec.width_m == pytest.approx(1.08)
    assert robot.mass_kg == pytest.approx(load_robot("agribot-hoe").mass_kg)
    assert not robot.warnings
