from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.autonomy.weeds.map import WeedMap
from agribot.autonomy.weeds.poses import PoseAt
from agribot.core.config import WeedConfig
from agribot.core.messages import PlantClass
from tests.autonomy.weeds.weed_field import (
    VIEW_BODY_M,
    add_sightings,
    make_estimate,
    make_plant,
    make_scene,
)

NO_VIEW: tuple[tuple[float, float], ...] = ()


def pose_at(
    x_m: float, y_m: float, yaw_rad: float, pos_std_m: float = 0.01, yaw_std_rad: float = 0.005
) -> PoseAt:
    p, q = pos_std_m**2, yaw_std_rad**2
    cov = (p, 0.0, 0.0, 0.0, p, 0.0, 0.0, 0.0, q)
    return PoseAt(t_s=0.0, x_map_m=x_m, y_map_m=y_m, yaw_map_rad=yaw_rad, cov=cov)


def look(
    weed_map: WeedMap,
    t_s: float,
    *plants: tuple[float, float, PlantClass],
    view: tuple[tuple[float, float], ...] = NO_VIEW,
) -> None:
    seen = tuple(make_plant(x, y, plant) for x, y, plant in plants)
    weed_map.add(make_scene(t_s, seen, view), pose_at(0.0, 0.0, 0.0))


def test_a_plant_is_placed_where_the_robot_was_at_capture_not_at_arrival() -> None:
    weed_map = WeedMap(WeedConfig())
    for i in range(50):
        weed_map.track_pose(make_estimate(0.02 * i, 3.0, 0.02 * i, math.pi / 2, v_mps=1.0))
    weed_map.add(make_scene(0.4, (make_plant(1.0, 0.25),)))
    (plant,) = weed_map.plants()
    assert (plant.x_map_m, plant.y_map_m) == pytest.approx((3.0 - 0.25, 0.4 + 1.0))


def test_a_scene_without_a_known_pose_is_dropped_and_counted() -> None:
    weed_map = WeedMap(WeedConfig())
    weed_map.track_pose(make_estimate(10.0, 0.0, 0.0, 0.0))
    weed_map.add(make_scene(1.0, (make_plant(1.0, 0.0),)))
    weed_map.add(make_scene(11.0, (make_plant(1.0, 0.0),)))
    assert weed_map.plants() == ()
    assert (weed_map.scenes_used, weed_map.scenes_dropped) == (0, 2)


def test_a_heading_error_widens_a_far_plant_across_the_line_of_sight_only() -> None:
    weed_map = WeedMap(WeedConfig())
    pose = pose_at(0.0, 0.0, 0.0, pos_std_m=0.001, yaw_std_rad=0.05)
    weed_map.add(make_scene(0.0, (make_plant(1.2, 0.0, std_m=0.01),)), pose)
    (plant,) = weed_map.plants()
    xx, xy, yx, yy = plant.cov_m2
    assert math.sqrt(yy - xx) == pytest.approx(1.2 * 0.05, rel=1e-3)
    assert xy == yx == pytest.approx(0.0, abs=1e-12)


def test_the_heading_error_turns_with_the_robot() -> None:
    """Propagated covariance against the sample covariance of displaced poses."""
    rng = np.random.default_rng(0)
    yaw, x_body, y_body = 2.1, 0.9, -0.4
    root = rng.normal(0.0, 1.0, (3, 3)) * [[0.01], [0.02], [0.01]]
    cov = root @ root.T
    drawn = rng.multivariate_normal([0.0, 0.0, yaw], cov, 40000)
    x = drawn[:, 0] + np.cos(drawn[:, 2]) * x_body - np.sin(drawn[:, 2]) * y_body
    y = drawn[:, 1] + np.sin(drawn[:, 2]) * x_body + np.cos(drawn[:, 2]) * y_body
    flat = [float(v) for v in cov.ravel()]
    pose = PoseAt(
        t_s=0.0,
        x_map_m=0.0,
        y_map_m=0.0,
        yaw_map_rad=yaw,
        cov=(*flat[:3], *flat[3:6], *flat[6:]),  # type: ignore[arg-type]
    )
    weed_map = WeedMap(WeedConfig())
    weed_map.add(make_scene(0.0, (make_plant(x_body, y_body, std_m=0.03),)), pose)
    (plant,) = weed_map.plants()
    own = np.eye(2) * (0.03**2 + 0.01**2)
    np.testing.assert_allclose(
        np.array(plant.cov_m2).reshape(2, 2) - own, np.cov(x, y), rtol=0.05, atol=2e-6
    )


def test_seeing_a_plant_often_does_not_average_out_the_robots_own_error() -> None:
    weed_map = WeedMap(WeedConfig())
    for i in range(200):
        weed_map.add(
            make_scene(0.1 * i, (make_plant(1.0, 0.0),)), pose_at(0.0, 0.0, 0.0, pos_std_m=0.05)
        )
    (plant,) = weed_map.plants()
    assert plant.cov_m2[0] >= 0.05**2
    assert plant.cov_m2[0] < 0.05**2 + 0.03**2 / 4


def test_a_well_placed_sighting_outweighs_many_badly_placed_ones_of_an_earlier_pass() -> None:
    weed_map = WeedMap(WeedConfig())
    for i in range(20):
        weed_map.add(
            make_scene(0.1 * i, (make_plant(1.08, 0.0),)), pose_at(0.0, 0.0, 0.0, pos_std_m=0.3)
        )
    weed_map.add(make_scene(30.0, (make_plant(1.0, 0.0),)), pose_at(0.0, 0.0, 0.0, pos_std_m=0.01))
    (plant,) = weed_map.plants()
    assert plant.x_map_m == pytest.approx(1.0, abs=0.005)
    assert math.sqrt(plant.cov_m2[0]) < 0.05


def test_a_weed_needs_the_configured_sightings_to_be_confirmed() -> None:
    weed_map = WeedMap(WeedConfig(min_sightings=4))
    for i in range(3):
        look(weed_map, 0.1 * i, (1.0, 0.0, PlantClass.WEED))
    assert weed_map.weeds() == ()
    assert len(weed_map.plants()) == 1
    look(weed_map, 0.3, (1.0, 0.0, PlantClass.WEED))
    (weed,) = weed_map.weeds()
    assert (weed.sightings, weed.first_seen_s, weed.last_seen_s) == (4, 0.0, 0.3)
    assert weed_map.weed_count == 1


def test_the_class_follows_the_majority_of_the_evidence() -> None:
    weed_map = WeedMap(WeedConfig())
    for i, name in enumerate([0, 1, 1, 0, 1, 1, 1]):
        look(weed_map, 0.1 * i, (1.0, 0.0, PlantClass(name)))
    assert weed_map.weeds() == ()
    (crop,) = weed_map.crops()
    assert crop.plant == PlantClass.CROP


def test_two_plants_seen_side_by_side_stay_two() -> None:
    weed_map = WeedMap(WeedConfig())
    for i in range(10):
        look(weed_map, 0.1 * i, (1.0, 0.0, PlantClass.WEED), (1.0, 0.09, PlantClass.CROP))
    assert len(weed_map.weeds()) == len(weed_map.crops()) == 1
    assert weed_map.crops()[0].y_map_m == pytest.approx(0.09)


def test_a_sighting_goes_to_the_nearer_plant_when_only_one_is_seen() -> None:
    weed_map = WeedMap(WeedConfig())
    add_sightings(weed_map, [(1.0, 0.0), (1.0, 0.11)])
    for i in range(5):
        look(weed_map, 2.0 + 0.1 * i, (1.0, 0.10, PlantClass.WEED))
    low, high = sorted(weed_map.weeds(), key=lambda plant: plant.y_map_m)
    assert low.sightings == 6
    assert high.sightings == 11


def test_between_two_plants_the_class_decides() -> None:
    weed_map = WeedMap(WeedConfig())
    add_sightings(weed_map, [(1.0, 0.0)], [(1.0, 0.11)])
    for i in range(5):
        look(weed_map, 2.0 + 0.1 * i, (1.0, 0.05, PlantClass.CROP))
    assert weed_map.weeds()[0].sightings == 6
    assert weed_map.crops()[0].sightings == 11


@pytest.mark.parametrize("view", [VIEW_BODY_M, VIEW_BODY_M[::-1]], ids=["right", "left"])
def test_a_plant_that_stands_in_full_view_unseen_loses_its_confirmation(
    view: tuple[tuple[float, float], ...],
) -> None:
    weed_map = WeedMap(WeedConfig())
    add_sightings(weed_map, [(1.0, 0.0)], times=3)
    assert len(weed_map.weeds()) == 1
    for i in range(15):
        look(weed_map, 2.0 + 0.1 * i, view=view)
    assert weed_map.weeds() == ()


@pytest.mark.parametrize("place_m", [(0.35, 0.0), (1.46, 0.0), (1.0, 0.58), (2.0, 0.0)])
def test_a_plant_at_the_edge_of_the_view_or_outside_may_go_unseen(
    place_m: tuple[float, float],
) -> None:
    weed_map = WeedMap(WeedConfig())
    add_sightings(weed_map, [place_m], times=4)
    for turned in (VIEW_BODY_M, VIEW_BODY_M[::-1]):
        for i in range(15):
            look(weed_map, 2.0 + 0.1 * i, view=turned)
    assert len(weed_map.weeds()) == 1


def test_a_lone_false_alarm_is_forgotten() -> None:
    weed_map = WeedMap(WeedConfig())
    look(weed_map, 0.0, (1.0, 0.0, PlantClass.WEED))
    look(weed_map, 30.0, (5.0, 0.0, PlantClass.WEED))
    assert [plant.x_map_m for plant in weed_map.plants()] == [5.0]


def test_tracks_that_drift_onto_each_other_become_one() -> None:
    """Two blobs of one plant grow together as the camera comes near."""
    weed_map = WeedMap(WeedConfig())
    for i in range(60):
        gap_m = max(0.13 - 0.01 * i, 0.0)
        look(weed_map, 0.1 * i, (1.0, 0.0, PlantClass.WEED), (1.0 + gap_m, 0.0, PlantClass.WEED))
        if i == 5:
            assert len(weed_map.weeds()) == 2
    (weed,) = weed_map.weeds()
    assert weed.id == 1
    assert weed.x_map_m == pytest.approx(1.0, abs=0.03)


def test_a_copy_left_behind_by_a_pose_jump_dies_out() -> None:
    weed_map = WeedMap(WeedConfig())
    for i in range(5):
        look(weed_map, 0.1 * i, (1.15, 0.0, PlantClass.WEED), view=VIEW_BODY_M)
    for i in range(20):
        look(weed_map, 1.0 + 0.1 * i, (1.0, 0.0, PlantClass.WEED), view=VIEW_BODY_M)
    (weed,) = weed_map.weeds()
    assert weed.x_map_m == pytest.approx(1.0, abs=0.01)


def test_soil_is_no_plant() -> None:
    weed_map = WeedMap(WeedConfig())
    look(weed_map, 0.0, (1.0, 0.0, PlantClass.SOIL))
    assert weed_map.plants() == ()


def test_plants_can_be_filtered_by_evidence() -> None:
    weed_map = WeedMap(WeedConfig())
    add_sightings(weed_map, [(1.0, 0.0)], times=8)
    look(weed_map, 1.0, (1.0, 0.5, PlantClass.WEED))
    assert len(weed_map.plants()) == 2
    assert len(weed_map.plants(min_sightings=2)) == 1
    assert len(weed_map.plants(min_confidence=0.9)) == 1


def test_what_was_seen_once_is_in_the_map_only_where_it_was_treated() -> None:
    weed_map = WeedMap(WeedConfig())
    add_sightings(weed_map, [(1.0, 0.0)], times=8)
    look(weed_map, 1.0, (1.0, 0.5, PlantClass.WEED))
    (sure,) = weed_map.export_plants()
    assert sure.sightings == 8 and len(weed_map.plants()) == 2
    (once,) = {plant.id for plant in weed_map.plants()} - {sure.id}
    weed_map.mark_treated(once, 2.0)
    assert [plant.id for plant in weed_map.export_plants()] == [sure.id, once]
    assert [track.id for track in weed_map.list_mapped()] == [sure.id, once]


def test_the_map_is_the_same_on_both_sides_of_the_origin() -> None:
    """Cells left and below zero are as good as the others."""
    weed_map = WeedMap(WeedConfig())
    for i in range(6):
        for x_m, y_m in ((-7.26, -3.01), (7.24, 2.99), (-0.01, 0.01)):
            weed_map.add(
                make_scene(0.1 * i, (make_plant(0.01 * (i % 2), 0.0),)), pose_at(x_m, y_m, 0.0)
            )
    assert sorted(weed.x_map_m for weed in weed_map.weeds()) == pytest.approx(
        [-7.255, -0.005, 7.245], abs=1e-3
    )
