"""Each ROS type becomes what its display reads, thinned, with its frame resolved."""

from __future__ import annotations

import base64
import io
import math
from typing import Any

import numpy as np
import pytest
from PIL import Image

from agribot.core.geo import transform
from agribot.record.bag.definitions import ros1_store, ros2_store
from agribot.ros.messages.frame_tree import FrameTree, matrix_of
from agribot.ros.messages.shown_messages import (
    MOST_BEAMS,
    MOST_CLOUD_POINTS,
    FramePlaces,
    UnknownFrame,
    read_cloud,
    show_message,
)
from agribot.ros.messages.shown_sets import MOST_CELLS, GridView, RouteView, make_view
from agribot.ros.messages.shown_types import GRID_UPDATE, SHOWN_TYPES
from tests.ros.messages import shown_samples as samples

MAP = FramePlaces(lambda _target, _source: None, {})


def show(message: Any, places: FramePlaces = MAP) -> dict[str, Any]:
    view = make_view(message.__msgtype__)
    view.take(message, 0.0)
    shown = view.show(places, 0.0)
    assert shown is not None
    return shown.value


@pytest.mark.parametrize("ros_type", sorted(SHOWN_TYPES))
def test_every_type_in_the_table_is_shown_from_the_bytes_of_both_ros_versions(
    ros_type: str,
) -> None:
    for store, is_ros2 in ((ros1_store(), False), (ros2_store(), True)):
        if ros_type not in store.fielddefs:
            continue
        message = samples.make_default(store, ros_type)
        data = (
            store.serialize_cdr(message, ros_type)
            if is_ros2
            else store.serialize_ros1(message, ros_type)
        )
        again = (
            store.deserialize_cdr(data, ros_type)
            if is_ros2
            else store.deserialize_ros1(data, ros_type)
        )
        assert isinstance(show(again), dict)


def test_a_scan_keeps_its_beams_and_says_null_where_nothing_was_met() -> None:
    scan = samples.scan([1.0, math.inf, math.nan, 2.5])
    value = show(scan)
    assert value["ranges"] == [1.0, None, None, 2.5]
    assert value["angle_increment"] == pytest.approx(0.5)


def test_a_scan_of_too_many_beams_is_thinned_over_the_same_angle() -> None:
    count = 3 * MOST_BEAMS
    shown = show_message(samples.scan([1.0] * count), MAP)
    assert len(shown.value["ranges"]) == MOST_BEAMS
    assert shown.value["angle_increment"] == pytest.approx(1.5)
    assert shown.left_out == f"{count:,} beams thinned to {MOST_BEAMS:,}"


def test_a_cloud_of_a_million_points_is_thinned_and_says_so() -> None:
    count = 1_000_000
    points = np.zeros((count, 4), dtype="<f4")
    points[:, 0] = np.arange(count)
    shown = show_message(samples.cloud(points), MAP)
    assert shown.value["width"] == MOST_CLOUD_POINTS
    assert len(base64.b64decode(shown.value["data"])) == 16 * MOST_CLOUD_POINTS
    assert shown.left_out == "1,000,000 points thinned to 20,000"


def test_a_cloud_of_other_numbers_and_a_padded_layout_has_the_same_points() -> None:
    points = np.array([[1.0, 2.0, 3.0, 9.0], [4.0, math.nan, 6.0, 9.0]])
    message = samples.cloud(points, kind=">f8", padding=5)
    read, names = read_cloud(message)
    assert names == ("x", "y", "z", "intensity")
    np.testing.assert_array_equal(read, points.astype("<f4"))
    assert show(message)["width"] == 1, "a point that is nowhere is left out"


def test_the_colours_of_a_cloud_keep_their_bits() -> None:
    points = np.zeros((1, 4), dtype="<f4")
    points[0, 3] = np.array([0x00112233], dtype="<u4").view("<f4")[0]
    value = show(samples.cloud(points, last="rgb"))
    packed = np.frombuffer(base64.b64decode(value["data"]), dtype="<u4")[3]
    assert packed == 0x00112233


def test_a_cloud_shorter_than_it_says_has_the_points_that_are_there() -> None:
    message = samples.cloud(np.ones((10, 4), dtype="<f4"))
    message.data = message.data[:-20]
    assert show(message)["width"] == 8


def test_a_frame_of_the_tree_is_placed_in_the_map_and_one_of_the_robot_on_it() -> None:
    tree = FrameTree()
    tree.set("map", "odom", transform((1.0, 0.0, 0.0)))
    tree.set("odom", "base", transform((0.0, 2.0, 0.0)))
    tree.set("base_link", "laser", transform((0.3, 0.0, 0.1)))
    places = FramePlaces(tree.find, {"base_link": transform((0.0, 0.0, 0.5))})
    assert places("/map") == {} == places("")
    in_map = np.reshape(places("base")["in_map"], (4, 4))
    np.testing.assert_allclose(in_map[:3, 3], [1.0, 2.0, 0.0])
    in_body = np.reshape(places("/laser")["in_body"], (4, 4))
    np.testing.assert_allclose(in_body[:3, 3], [0.3, 0.0, 0.6])
    with pytest.raises(UnknownFrame, match="'moon' is not known"):
        places("moon")


def test_a_tree_with_a_circle_or_without_a_common_root_ends() -> None:
    tree = FrameTree()
    tree.set("a", "b", np.eye(4))
    tree.set("b", "a", np.eye(4))
    tree.set("map", "c", np.eye(4))
    assert tree.find("map", "a") is None
    assert tree.frames == ("a", "b", "c", "map")


def test_a_quaternion_of_zeros_is_no_rotation_and_one_that_is_not_finite_none_at_all() -> None:
    place, still = samples.vector(1.0, 2.0, 3.0), samples.quaternion(0.0, 0.0, 0.0, 0.0)
    matrix = matrix_of(place, still)
    assert matrix is not None
    np.testing.assert_array_equal(matrix[:3, :3], np.eye(3))
    assert matrix_of(place, samples.quaternion(0.0, 0.0, math.nan, 1.0)) is None


def test_markers_add_up_end_and_are_named_where_their_frame_is_unknown() -> None:
    view = make_view("visualization_msgs/msg/MarkerArray")
    view.take(samples.marker(1), 0.0)
    view.take(samples.marker(2, lifetime_s=5.0), 0.0)
    view.take(samples.marker(3, frame="moon"), 0.0)
    shown = view.show(MAP, 1.0)
    assert shown is not None
    assert [m["id"] for m in shown.value["markers"][1:]] == [1, 2]
    assert shown.value["markers"][0]["action"] == 3, "what the page had is forgotten first"
    assert "1 of 3 markers: frame 'moon'" in shown.problem
    later = view.show(MAP, 6.0)
    assert later is not None
    assert [m["id"] for m in later.value["markers"][1:]] == [1]
    view.take(samples.marker(1, action=2), 7.0)
    empty = view.show(MAP, 7.0)
    assert empty is not None
    assert empty.value["markers"][1:] == []


def test_a_grid_takes_its_updates_and_ignores_one_outside() -> None:
    view = GridView()
    view.take(samples.grid(np.zeros((3, 4), dtype=np.int8)), 0.0)
    view.take(samples.grid_update(1, 1, np.full((2, 2), 100, dtype=np.int8)), 0.0)
    view.take(samples.grid_update(3, 2, np.full((2, 2), 50, dtype=np.int8)), 0.0)
    shown = view.show(MAP, 0.0)
    assert shown is not None
    cells = np.frombuffer(base64.b64decode(shown.value["data"]), dtype=np.int8).reshape(3, 4)
    assert cells.tolist() == [[0, 0, 0, 0], [0, 100, 100, 0], [0, 100, 100, 0]]


def test_a_route_takes_the_place_on_it_and_none_of_another_route() -> None:
    """Half a metre beyond the second point, which is 5 m from the first."""
    view = RouteView()
    position = "marti_nav_msgs/msg/RoutePosition"
    view.take(samples.make(position, samples.header(), "", "b", 0.5), 0.0)
    assert view.show(MAP, 0.0) is None
    route = samples.make_default(ros2_store(), "marti_nav_msgs/msg/Route")
    for id, x, y in (("a", 0.0, 0.0), ("b", 3.0, 4.0), ("c", 3.0, 9.0)):
        point = samples.make_default(ros2_store(), "marti_nav_msgs/msg/RoutePoint")
        point.id, point.pose = id, samples.pose(x, y)
        route.route_points.append(point)
    view.take(route, 0.0)
    shown = view.show(MAP, 0.0)
    assert shown is not None
    assert (len(shown.value["route_points"]), shown.value["position_m"]) == (3, 5.5)
    view.take(samples.make(position, samples.header(), "", "elsewhere", 0.5), 0.0)
    shown = view.show(MAP, 0.0)
    assert shown is not None
    assert "position_m" not in shown.value


def test_a_large_grid_is_folded_to_the_most_occupied_cells() -> None:
    cells = np.full((1001, 1000), -1, dtype=np.int8)
    cells[1000, 3] = 77
    view = GridView()
    view.take(samples.grid(cells, resolution=0.1), 0.0)
    shown = view.show(MAP, 0.0)
    assert shown is not None
    info = shown.value["info"]
    assert info["width"] * info["height"] <= MOST_CELLS
    assert (info["width"], info["height"]) == (500, 501)
    assert info["resolution"] == pytest.approx(0.2)
    folded = np.frombuffer(base64.b64decode(shown.value["data"]), dtype=np.int8)
    assert folded.reshape(501, 500)[500, 1] == 77
    assert shown.left_out == "1000 x 1001 cells folded to 500 x 501"


def test_a_disparity_is_thinned_to_numbers_and_another_encoding_refused() -> None:
    pixels = np.arange(480 * 640, dtype="<f4").reshape(480, 640)
    value = show(samples.disparity(pixels))
    image = value["image"]
    assert (image["width"], image["height"]) == (320, 240)
    kept = np.frombuffer(base64.b64decode(image["data"]), dtype="<f4").reshape(240, 320)
    np.testing.assert_array_equal(kept, pixels[::2, ::2])


def test_a_large_picture_becomes_a_small_jpeg() -> None:
    pixels = np.zeros((960, 1280, 3), dtype=np.uint8)
    pixels[..., 0] = 200
    shown = show_message(samples.image(pixels), MAP)
    picture = Image.open(io.BytesIO(base64.b64decode(shown.value["data"])))
    assert picture.size == (640, 480)
    red, green, blue = picture.getpixel((5, 5))  # type: ignore[misc]
    assert red > 180
    assert max(green, blue) < 20
    assert shown.left_out == "1280 x 960 pixels made smaller"


def test_a_texture_keeps_its_size_on_the_ground_when_it_is_made_smaller() -> None:
    value = show(samples.texture(np.zeros((100, 2048, 3), dtype=np.uint8), resolution=0.01))
    marker = value["markers"][0]
    picture = Image.open(io.BytesIO(base64.b64decode(marker["image"]["data"])))
    assert picture.width * marker["resolution"] == pytest.approx(20.48)


def test_the_update_of_a_grid_has_the_definition_of_ros() -> None:
    _, md5 = ros1_store().generate_msgdef(GRID_UPDATE, ros_version=1)
    assert md5 == "b295be292b335c34718bd939deebe1c9"
