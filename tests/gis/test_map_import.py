"""Maps of other formats become tiles that lie where they belong."""

from __future__ import annotations

import io
import json
import shutil
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.cli.main import main
from agribot.core.errors import ConfigError
from agribot.core.geo import Datum, MapFrame
from agribot.gis.map_import import check_template
from agribot.gis.mbtiles import describe_map, read_tile
from agribot.gis.tile_grid import (
    GeoBounds,
    MapTile,
    count_tiles,
    find_tile,
    iterate_tiles,
    parse_bounds,
)

DATUM = Datum(lat_deg=21.161289, lon_deg=72.787022)
UTM = "EPSG:32643"
RED, GREEN = (220, 30, 30), (40, 160, 60)


@pytest.fixture(autouse=True)
def maps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AGRIBOT_HOME", str(tmp_path / "home"))
    return tmp_path / "home" / "maps"


def place(east_m: float, north_m: float) -> tuple[float, float]:
    lat_deg, lon_deg, _ = MapFrame(DATUM).geodetic_from_map(east_m, north_m)
    return lat_deg, lon_deg


def colour_at(path: Path, east_m: float, north_m: float) -> tuple[int, ...]:
    return find_colour(path, *place(east_m, north_m))


def find_colour(path: Path, lat_deg: float, lon_deg: float) -> tuple[int, ...]:
    """Of the finest tile that covers a place."""
    z = describe_map(path)["maxzoom"]
    whole = 2**30
    fine = find_tile(lat_deg, lon_deg, 30)
    address = find_tile(lat_deg, lon_deg, z)
    data = read_tile(path, *address)
    if data is None:
        return ()
    px = (
        int((fine.x / whole * 2**z - address.x) * 256),
        int((fine.y / whole * 2**z - address.y) * 256),
    )
    found = Image.open(io.BytesIO(data)).convert("RGBA").getpixel(px)
    assert isinstance(found, tuple)
    return found


@pytest.fixture
def ortho(tmp_path: Path) -> Path:
    """10 cm pixels in UTM, green, with a red square of 4 m around a place of the field."""
    rasterio = pytest.importorskip("rasterio")
    from rasterio.warp import transform

    lat_deg, lon_deg = place(10.0, 20.0)
    (east_m,), (north_m,) = transform("EPSG:4326", UTM, [lon_deg], [lat_deg])
    pixels = np.empty((3, 400, 400), dtype=np.uint8)
    pixels[:] = np.array(GREEN, dtype=np.uint8)[:, None, None]
    pixels[:, 180:220, 180:220] = np.array(RED, dtype=np.uint8)[:, None, None]
    path = tmp_path / "ortho.tif"
    with rasterio.open(
        path, "w", driver="GTiff", width=400, height=400, count=3, dtype="uint8", crs=UTM,
        transform=rasterio.Affine(0.1, 0.0, east_m - 20.0, 0.0, -0.1, north_m + 20.0),
    ) as raster:  # fmt: skip
        raster.write(pixels)
    return path


def near(colour: tuple[int, ...], wanted: tuple[int, int, int]) -> bool:
    return len(colour) == 4 and max(abs(a - b) for a, b in zip(colour, wanted, strict=False)) < 40


def test_a_geotiff_lies_where_it_was_taken(
    ortho: Path, maps: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["map", "--json", "import", str(ortho)]) == 0
    (shown,) = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (shown["name"], shown["format"]) == ("ortho", "webp")
    assert shown["maxzoom"] == 21, "7 cm pixels at this latitude"
    path = maps / "ortho.mbtiles"
    for east_m, north_m, colour in (
        (10.0, 20.0, RED), (11.7, 18.3, RED), (12.4, 20.0, GREEN), (10.0, 22.4, GREEN),
        (-5.0, 35.0, GREEN),
    ):  # fmt: skip
        assert near(colour_at(path, east_m, north_m), colour), (east_m, north_m)
    assert colour_at(path, 40.0, 20.0)[3:] in {(), (0,)}, "nothing beyond the picture"
    coarse = find_tile(*place(10.0, 20.0), shown["minzoom"])
    assert read_tile(path, *coarse) is not None, "the whole picture at a glance"


def test_a_picture_without_a_place_is_refused(
    tmp_path: Path, maps: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rasterio")
    Image.new("RGB", (8, 8)).save(tmp_path / "plain.tif")
    (tmp_path / "text.tif").write_text("no raster")
    assert main(["map", "import", str(tmp_path / "plain.tif")]) == 2
    assert "does not say where it lies" in capsys.readouterr().err
    assert main(["map", "import", str(tmp_path / "text.tif")]) == 2
    assert not list(maps.glob("*"))


def write_raster(path: Path, bands: list[np.ndarray], place_of: str = UTM, **more: object) -> None:
    """Write pixels of 10 m at a place of the field, or where `transform` puts them."""
    rasterio = pytest.importorskip("rasterio")
    height, width = bands[0].shape
    colours, table = more.pop("colours", None), more.pop("table", None)
    settings = {"transform": rasterio.Affine(10.0, 0.0, 270_000.0, 0.0, -10.0, 2_342_000.0), **more}
    with rasterio.open(
        path, "w", driver="GTiff", width=width, height=height, count=len(bands),
        dtype=bands[0].dtype, crs=place_of, **settings,
    ) as raster:  # fmt: skip
        for number, band in enumerate(bands, start=1):
            raster.write(band, number)
        if colours is not None:
            raster.colorinterp = colours
        if table is not None:
            raster.write_colormap(1, table)


def list_colours(path: Path) -> np.ndarray:
    """All pixels of a map's finest tiles, (N, 4)."""
    with closing(sqlite3.connect(path)) as database:
        tiles = database.execute(
            "SELECT tile_data FROM tiles WHERE zoom_level = (SELECT max(zoom_level) FROM tiles)"
        ).fetchall()
    pictures = [Image.open(io.BytesIO(data)).convert("RGBA") for (data,) in tiles]
    return np.concatenate([np.asarray(picture).reshape(-1, 4) for picture in pictures])


def test_a_picture_with_an_alpha_band_is_transparent_where_that_says_so(
    tmp_path: Path, maps: Path
) -> None:
    """As the orthophotos of drones are."""
    pytest.importorskip("rasterio")
    from rasterio.enums import ColorInterp

    flat = np.full((64, 64), 200, dtype=np.uint8)
    alpha = np.where(np.arange(64)[None, :] < 32, 255, 0).astype(np.uint8).repeat(64, axis=0)
    kinds = (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)
    write_raster(tmp_path / "drone.tif", [flat, flat // 2, flat // 4, alpha], colours=kinds)
    assert main(["map", "import", str(tmp_path / "drone.tif")]) == 0
    pixels = list_colours(maps / "drone.mbtiles")
    shown = pixels[pixels[:, 3] > 250]
    assert np.abs(np.median(shown[:, :3], axis=0) - (200, 100, 50)).max() < 25
    write_raster(tmp_path / "whole.tif", [flat, flat, flat])
    assert main(["map", "import", str(tmp_path / "whole.tif")]) == 0
    whole = list_colours(maps / "whole.mbtiles")
    assert len(shown) == pytest.approx((whole[:, 3] > 250).sum() / 2, rel=0.05)


def test_numbers_of_a_palette_become_its_colours(tmp_path: Path, maps: Path) -> None:
    """As topographic maps are stored."""
    numbers = np.full((64, 64), 7, dtype=np.uint8)
    numbers[:, 32:] = 9
    write_raster(tmp_path / "topo.tif", [numbers], table={7: (*RED, 255), 9: (*GREEN, 255)})
    assert main(["map", "import", str(tmp_path / "topo.tif")]) == 0
    pixels = list_colours(maps / "topo.mbtiles")
    shown = pixels[pixels[:, 3] > 250].tolist()
    found = [sum(near(tuple(pixel), colour) for pixel in shown) for colour in (RED, GREEN)]
    assert min(found) > 0.45 * len(shown)


def test_a_picture_that_lies_nowhere_or_shows_nothing_is_refused_in_a_sentence(
    tmp_path: Path, maps: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rasterio = pytest.importorskip("rasterio")
    flat = np.full((16, 16), 200, dtype=np.uint8)
    step = rasterio.Affine(0.001, 0.0, 179.995, 0.0, -0.001, 10.0)
    local = 'LOCAL_CS["site",UNIT["metre",1]]'
    for name, system, more, told in (
        ("local", local, {}, "local.tif lies nowhere on Earth"),
        ("beyond", "EPSG:4326", {}, "beyond.tif lies nowhere on Earth"),
        ("cut", "EPSG:4326", {"transform": step}, "across the line of 180 degrees"),
        ("empty", UTM, {"nodata": 200}, "has no picture that a map can show"),
    ):
        write_raster(tmp_path / f"{name}.tif", [flat], system, **more)
        assert main(["map", "import", str(tmp_path / f"{name}.tif")]) == 2
        assert told in capsys.readouterr().err
    assert not list(maps.glob("*"))


def png(colour: tuple[int, int, int]) -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", (256, 256), colour).save(buffer, "PNG")
    return buffer.getvalue()


def test_a_pmtiles_archive_keeps_its_tiles(tmp_path: Path, maps: Path) -> None:
    pytest.importorskip("pmtiles")
    from pmtiles.tile import Compression, TileType, zxy_to_tileid
    from pmtiles.writer import Writer

    source = tmp_path / "farm.pmtiles"
    addresses = [(14, 11504, 7203), (15, 23008, 14406), (15, 23009, 14407)]
    with source.open("wb") as file:
        writer = Writer(file)
        for number, address in enumerate(addresses):
            writer.write_tile(zxy_to_tileid(*address), png((number, 0, 0)))
        edges = {"min_lon_e7": 727800000, "min_lat_e7": 211600000,
                 "max_lon_e7": 727900000, "max_lat_e7": 211700000}  # fmt: skip
        header = {"tile_type": TileType.PNG, "tile_compression": Compression.NONE, **edges,
                  "center_zoom": 14, "center_lon_e7": 0, "center_lat_e7": 0}  # fmt: skip
        writer.finalize(header, {})
    assert main(["map", "import", str(source)]) == 0
    for number, address in enumerate(addresses):
        assert read_tile(maps / "farm.mbtiles", *address) == png((number, 0, 0))
    assert describe_map(maps / "farm.mbtiles")["bounds"] == pytest.approx(
        [72.78, 21.16, 72.79, 21.17]
    )
    source.write_bytes(b"none")
    assert main(["map", "import", str(source)]) == 2


class TileServer(ThreadingHTTPServer):
    """Gives a tile of one colour for every address but one."""

    daemon_threads = True
    asked: list[str]
    broken = ""  # how the addresses end whose tiles fail


class _Answer(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        assert isinstance(self.server, TileServer)
        self.server.asked.append(self.path)
        is_missing = self.path.endswith("/14412.png")
        if self.server.broken and self.path.endswith(self.server.broken):
            self.send_error(500)
            return
        self.send_response(404 if is_missing else 200)
        self.end_headers()
        self.wfile.write(b"" if is_missing else png(RED))

    def log_message(self, format: str, *args: object) -> None:
        """The test reads `asked` instead."""


@pytest.fixture
def server() -> Iterator[tuple[TileServer, str]]:
    with TileServer(("127.0.0.1", 0), _Answer) as server:
        server.asked = []
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server, f"http://127.0.0.1:{server.server_address[1]}/{{z}}/{{x}}/{{y}}.png"
        server.shutdown()
        thread.join()


def test_a_region_is_fetched_once_and_what_was_missing_again(
    server: tuple[TileServer, str], maps: Path
) -> None:
    tiles, url = server
    region = ["--bbox", "72.785,21.160,72.790,21.163", "--zoom", "14-15", "--name", "aerial"]
    assert main(["map", "import", url, *region]) == 0
    wanted = count_tiles(GeoBounds(72.785, 21.160, 72.790, 21.163), 14, 15)
    assert len(tiles.asked) == len(set(tiles.asked)) == wanted
    missing = [path for path in tiles.asked if path.endswith("/14412.png")]
    assert describe_map(maps / "aerial.mbtiles")["tiles"] == wanted - len(missing)
    tiles.asked.clear()
    assert main(["map", "import", url, *region]) == 0
    assert sorted(tiles.asked) == sorted(missing)


def test_tiles_that_fail_are_counted_and_the_import_is_not_called_good(
    server: tuple[TileServer, str], maps: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tiles, url = server
    region = ["--bbox", "72.77,21.15,72.80,21.18", "--zoom", "14-15", "--name", "aerial"]
    tiles.broken = "/14412.png"
    assert main(["map", "import", url, *region]) == 1
    told = capsys.readouterr().err
    assert "tiles did not come: HTTP Error 500" in told and "the same command" in told
    tiles.broken = ""
    assert main(["map", "import", url, *region]) == 0
    assert "the server has no tile at" in capsys.readouterr().err


def test_an_import_without_a_tile_leaves_no_map_and_a_broken_one_can_be_listed_and_removed(
    server: tuple[TileServer, str], maps: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tiles, url = server
    region = ["--bbox", "72.785,21.160,72.790,21.163", "--zoom", "14-14"]
    assert main(["map", "import", url, *region, "--name", "good"]) == 0
    tiles.broken = ".png"
    for template in (url, url.replace("/{z}", "/no http/{z}"), url.replace("http:", "https:")):
        assert main(["map", "import", template, *region, "--name", "none"]) == 2
        assert "no tile came from" in capsys.readouterr().err
    elsewhere = ["--bbox", "10.1,50.1,10.2,50.2", "--zoom", "10-10", "--name", "good"]
    assert main(["map", "import", url, *elsewhere]) == 2
    assert [path.name for path in maps.iterdir()] == ["good.mbtiles"]
    assert describe_map(maps / "good.mbtiles")["tiles"] == 1, "what was there stays"
    capsys.readouterr()
    (maps / "broken.mbtiles").write_bytes(b"SQLite format 3")
    assert main(["map", "list"]) == 1
    shown = capsys.readouterr()
    assert shown.out.startswith("good: ") and "agribot map remove broken" in shown.err
    assert main(["map", "remove", "broken"]) == 0
    assert main(["map", "list"]) == 0


def test_a_server_adds_no_tiles_to_a_map_that_came_from_elsewhere(
    server: tuple[TileServer, str], maps: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    tiles, url = server
    region = ["--bbox", "72.785,21.160,72.790,21.163", "--zoom", "14-14"]
    assert main(["map", "import", url, *region, "--name", "aerial"]) == 0
    shutil.copy(maps / "aerial.mbtiles", tmp_path / "drone.mbtiles")
    with closing(sqlite3.connect(tmp_path / "drone.mbtiles")) as database:
        database.execute("DELETE FROM metadata WHERE name = 'agribot_server'")
        database.commit()
    assert main(["map", "import", str(tmp_path / "drone.mbtiles")]) == 0
    before = {path.name: path.read_bytes() for path in maps.iterdir()}
    tiles.asked.clear()
    other = url.replace("/{z}", "/other/{z}")
    for name, words in (("aerial", [other]), ("aerial", [other, "--live"]), ("drone", [url])):
        assert main(["map", "import", *words, *region, "--name", name]) == 2
        told = capsys.readouterr().err
        assert f"there is a map '{name}' already" in told and f"map remove {name}" in told
    assert not tiles.asked
    assert {path.name: path.read_bytes() for path in maps.iterdir()} == before


def test_another_region_of_the_same_server_joins_the_map(
    server: tuple[TileServer, str], maps: Path
) -> None:
    _, url = server
    for region, zoom in (("72.78,21.16,72.785,21.163", "16"), ("72.79,21.17,72.8,21.2", "14")):
        words = ["--bbox", region, "--zoom", zoom, "--name", "aerial"]
        assert main(["map", "import", url, *words]) == 0
    shown = describe_map(maps / "aerial.mbtiles")
    assert shown["bounds"] == pytest.approx([72.78, 21.16, 72.8, 21.2])
    assert (shown["minzoom"], shown["maxzoom"]) == (14, 16)


@pytest.mark.parametrize(
    "words",
    [
        ["--name", "a"],
        ["--name", "a", "--bbox", "72,21,73"],
        ["--name", "a", "--bbox", "73,21,72,22"],
        ["--name", "a", "--bbox=-180,-80,180,80", "--zoom", "0-20"],
        ["--name", "a", "--bbox", "72,21,72.1,21.1", "--zoom", "nine"],
        ["--name", "a", "--bbox", "72,21,72.1,21.1", "--zoom", "12-9"],
        ["--bbox", "72,21,72.1,21.1"],
        ["--name", "../../x", "--bbox", "72,21,72.1,21.1"],
    ],
)
def test_a_region_that_cannot_be_meant_is_refused_before_anything_is_asked(
    server: tuple[TileServer, str], words: list[str]
) -> None:
    assert main(["map", "import", server[1], *words]) == 2
    assert server[0].asked == []


@pytest.mark.parametrize(
    "template",
    ["file:///etc/passwd", "http://x/{z}/{x}", "http://x/{z}/{x}/{y}/{key}", "http://x/{0}", "x"],
)
def test_only_addresses_of_tile_servers_are_taken(template: str) -> None:
    with pytest.raises(ConfigError, match="no address of a tile server"):
        check_template(template)


def test_the_grid_covers_a_region_without_gaps() -> None:
    bounds = parse_bounds("72.78,21.15,72.80,21.17")
    tiles = list(iterate_tiles(bounds, 14, 16))
    assert len(tiles) == len(set(tiles)) == count_tiles(bounds, 14, 16)
    for lat_deg, lon_deg in ((21.15, 72.78), (21.16, 72.79), (21.17, 72.80)):
        assert find_tile(lat_deg, lon_deg, 16) in tiles
    left, bottom, right, top = MapTile(1, 1, 0).compute_edges_m()
    assert (left, bottom) == pytest.approx((0.0, 0.0))
    assert right == top == pytest.approx(20037508.342789244)
