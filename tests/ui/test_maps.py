"""Tiles on their way to the page: kept ones, those of a server behind them, and nothing else."""

from __future__ import annotations

from http.client import HTTPConnection

import pytest

from agribot.cli.main import main
from agribot.core.home import find_home
from agribot.gis.mbtiles import describe_map
from tests.gis.test_map_import import RED, TileServer, png, server
from tests.ui.client import Browser
from tests.ui.conftest import Robot
from tests.waiting import PATIENCE_S

__all__ = ["server"]


@pytest.fixture
def browser(robot: Robot) -> Browser:
    return Browser(robot.port)


def test_a_live_map_fetches_a_tile_once_and_works_without_its_server_afterwards(
    browser: Browser, server: tuple[TileServer, str]
) -> None:
    tiles, url = server
    words = ["--name", "live", "--zoom", "3-18", "--live", "--attribution", "us"]
    assert main(["map", "import", url, *words]) == 0
    shown = next(one for one in browser.ask("GET", "/api/v1/maps")[1] if one["name"] == "live")
    assert (shown["minzoom"], shown["maxzoom"], shown["attribution"]) == (3, 18, "us")
    for _ in range(2):
        assert browser.ask("GET", "/tiles/live/15/23008/14400") == (200, png(RED))
    assert tiles.asked == ["/15/23008/14400.png"]
    assert browser.ask("GET", "/tiles/live/15/23008/14412")[0] == 204, "the server has none"
    assert describe_map(find_home() / "maps" / "live.mbtiles")["tiles"] == 1
    assert main(["map", "remove", "live"]) == 0
    assert browser.ask("GET", "/tiles/live/15/23008/14400")[0] == 404


@pytest.mark.parametrize(
    "path",
    [
        "/tiles/../../etc/passwd/1/1/1",
        "/tiles/..%2f..%2fetc%2fpasswd/1/1/1",
        "/tiles/%2e%2e/1/1/1",
        "/tiles/farm.mbtiles/1/1/1",
        "/tiles/farm/1/1/../../../../etc/passwd",
        "/tiles/farm/-1/0/0",
        "/tiles/farm/1/1e3/0",
        "/tiles/farm%00/1/1/1",
        "/tiles/farm/999999999999999999999/1/1",
    ],
)
def test_nothing_but_tiles_of_known_maps_is_served(robot: Robot, path: str) -> None:
    line = HTTPConnection("127.0.0.1", robot.port, timeout=PATIENCE_S)
    line.request("GET", path)
    answer = line.getresponse()
    data = answer.read()
    line.close()
    assert answer.status in {204, 400, 404}
    assert b"root:" not in data
