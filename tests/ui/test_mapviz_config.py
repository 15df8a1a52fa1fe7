"""A configuration of mapviz becomes displays of ours, and ours become one of mapviz."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette")
from ruamel.yaml import YAML

from agribot.ui.server.answers import Unusable
from agribot.ui.server.mapviz_config import config_of, displays_of
from agribot.ui.server.mapviz_table import TABLE

FARM = (Path(__file__).parent / "data" / "farm.mvc").read_bytes()


def by_title(found: dict[str, Any]) -> dict[str, Any]:
    return {display["title"]: display for display in found["displays"]}


def test_types_topics_colours_and_order_are_those_of_the_file() -> None:
    found = displays_of(FARM)
    assert [display["title"] for display in found["displays"]] == [
        "satellite", "grid", "trajectory", "goals", "lidar", "camera", "filtered",
    ]  # fmt: skip
    named = by_title(found)
    assert named["trajectory"] == {
        "type": "navsat", "title": "trajectory", "source": "/agribot/fix", "visible": True,
        "opacity": 1.0,
        "options": {"color": "#0000ff", "style": "lines", "buffer": 20000, "tolerance_m": 0.2},
    }  # fmt: skip
    assert not named["goals"]["visible"] and named["goals"]["options"]["color"] == "#00ff00"
    assert named["grid"]["opacity"] == 0.5 and named["grid"]["options"]["rows"] == 12
    lidar = named["lidar"]["options"]
    assert (lidar["by"], lidar["color"], lidar["low"], lidar["high"]) == ("y", "#ff5500", 1.5, 9.0)
    camera = named["camera"]["options"]
    assert (camera["anchor"], camera["units"], camera["w"]) == ("top centre", "%", 30.0)
    assert named["satellite"]["source"] == "Stamen (terrain)"


def test_what_has_no_counterpart_is_named_with_the_reason() -> None:
    why = {entry["name"]: entry["why"] for entry in displays_of(FARM)["left_out"]}
    assert set(why) == {"measuring", "house made", "filtered"}
    assert "at the left of the map" in why["measuring"]
    assert "no display 'swri_mapviz/gps_waypoints'" in why["house made"]
    assert "position_tolerance = 'a lot'" in why["filtered"]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"displays: [}", "not the YAML"),
        (b"- 1\n- 2", "no list 'displays'"),
        (b"displays: 3", "no list 'displays'"),
        (b"displays: [3]", "no list 'displays'"),
        (b"\xff\xfe\x00", "not the YAML"),
        (b"!!python/object/apply:os.system ['true']", "not the YAML"),
        (b"displays: [" + b"{}," * 300 + b"]", "at most 200"),
        (b"#" * 1_000_001, "larger than"),
    ],
)
def test_what_is_no_configuration_is_refused_in_one_sentence(data: bytes, reason: str) -> None:
    with pytest.raises(Unusable, match=reason):
        displays_of(data)


def test_out_and_in_again_it_is_the_same() -> None:
    kept = [display for display in displays_of(FARM)["displays"] if display["type"] != "grid"]
    again = displays_of(config_of([{**display, "id": "x"} for display in kept]))["displays"]
    for before, after in zip(kept, again, strict=True):
        assert {**after, "opacity": 0} == {**before, "opacity": 0}
    tree = YAML(typ="safe", pure=True).load(config_of(kept).decode())
    assert tree["displays"][1]["type"] == "mapviz_plugins/navsat"
    assert tree["displays"][1]["config"]["draw_style"] == "lines"


@pytest.mark.parametrize(
    ("lines", "target", "turn"),
    [
        ("target_frame: <none>\nrotate_90: true", "map", 0),
        ("target_frame: map\nrotate_90: true", "map", 90),
        ("target_frame: /robot/base_link\nfix_orientation: true", "position", 0),
        ("target_frame: base_link\nfix_orientation: true\nrotate_90: true", "position", 90),
        ("target_frame: base_link\nrotate_90: true", "heading", 0),
        ("target_frame: base_link", "heading", 270),
    ],
)
def test_what_the_map_stays_on_is_kept_in_and_out(lines: str, target: str, turn: int) -> None:
    view = displays_of(f"{lines}\ndisplays: []".encode())["view"]
    assert view == {"target": target, "turn": turn}
    assert displays_of(config_of([], view))["view"] == view


def test_every_kind_of_the_page_has_a_row_or_is_a_tool() -> None:
    types = Path(__file__).parents[2] / "web" / "src" / "displays" / "types.ts"
    text = types.read_text()
    for kind in TABLE:
        assert f"'{kind}'" in text
    assert displays_of(config_of([]))["displays"] == []
    with pytest.raises(Unusable, match="no displays"):
        config_of([{"type": "grid"}])
