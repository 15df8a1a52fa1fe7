"""Programs outside of the robot add layers to the map, and no stranger does."""

from __future__ import annotations

import json
from typing import Any

import pytest

from agribot.ui import wire
from agribot.ui.server.outside_layers import (
    MOST_BYTES,
    MOST_LAYERS,
    BadLayer,
    OutsideLayers,
    make_id,
)
from tests.ui.client import Browser
from tests.ui.conftest import Robot

STONE = {"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": [8, 50]}}


@pytest.fixture
def layers() -> OutsideLayers:
    return OutsideLayers({"geojson", "marker", "laserscan"}.__contains__)


def test_a_layer_is_added_changed_and_removed_over_http_without_a_restart(robot: Robot) -> None:
    robot.answers[wire.ListPanels] = []
    browser = Browser(robot.port)
    body = {"data": STONE, "style": {"color": "#d07000"}, "draw_order": 0}
    assert browser.ask("PUT", "/api/v1/layers/stones", body)[0] == 201
    panels = browser.ask("GET", "/api/v1/panels")[1]
    [panel] = [each for each in panels if each["title"] == "stones"]
    assert (panel["kind"], panel["type"], panel["draw_order"]) == ("layer", "geojson", 0)
    assert browser.ask("GET", f"/api/v1/panels/{panel['id']}")[1] == STONE
    body["draw_order"] = 2
    assert browser.ask("PUT", "/api/v1/layers/stones", body)[0] == 200
    scan = {"name": "scan", "type": "laserscan", "topic": "ros1:/scan"}
    assert browser.ask("POST", "/api/v1/layers", scan)[0] == 201
    listed = {each["title"]: each for each in browser.ask("GET", "/api/v1/layers")[1]}
    assert listed["stones"]["draw_order"] == 2
    assert listed["scan"]["topic"] == "ros1:/scan"
    for name in ("stones", "scan"):
        assert browser.ask("DELETE", f"/api/v1/layers/{name}")[0] == 204
    assert browser.ask("DELETE", "/api/v1/layers/stones")[0] == 404
    assert browser.ask("GET", "/api/v1/layers")[1] == []


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"name": ""}, "1 to 60"),
        ({"type": "hologram"}, "is no display"),
        ({"data": None}, "give data or a topic"),
        ({"topic": "ros1:/scan"}, "give data or a topic"),
        ({"data": {"type": "Point"}}, "Feature"),
        ({"data": {"type": "FeatureCollection", "features": [1]}}, "features"),
        ({"data": {**STONE, "properties": {"text": "x" * MOST_BYTES}}}, "thin it"),
    ],
)
def test_a_layer_that_cannot_be_drawn_is_refused_with_the_reason(
    layers: OutsideLayers, change: dict[str, Any], why: str
) -> None:
    fields = {"name": "stones", "data": STONE, **change}
    with pytest.raises(BadLayer, match=why):
        layers.set(wire.OutsideLayer(**fields))
    assert layers.names() == []


def test_there_is_a_limit_of_layers_that_a_change_of_one_does_not_meet(
    layers: OutsideLayers,
) -> None:
    for number in range(MOST_LAYERS):
        layers.set(wire.OutsideLayer(name=f"layer {number}", data=STONE))
    with pytest.raises(BadLayer, match="delete one"):
        layers.set(wire.OutsideLayer(name="another", data=STONE))
    layers.set(wire.OutsideLayer(name="layer 0", data=STONE))


def test_names_that_look_alike_have_different_ids() -> None:
    assert len({make_id(name) for name in ("a b", "a-b", "A b", "ä")}) == 4


def test_a_message_of_ros_sets_and_deletes_a_layer(layers: OutsideLayers) -> None:
    said = {"name": "stones", "data": STONE, "draw_order": 1}
    assert layers.obey(json.dumps(said)) == "layer 'stones' set"
    assert json.loads(layers.read(make_id("stones")) or b"") == STONE
    assert layers.obey('{"name": "stones", "action": "delete"}') == "layer 'stones' removed"
    for text in ("{", '{"name": "a", "wrong": 1}', '{"name": "a", "action": "burn"}'):
        with pytest.raises(BadLayer):
            layers.obey(text)
