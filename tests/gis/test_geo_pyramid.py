"""Mapviz's multi-resolution images become maps that lie where their tie points say."""

from __future__ import annotations

import io
import json
import math
from pathlib import Path

import pytest
from PIL import Image

pytest.importorskip("rasterio")

from agribot.cli.main import main
from agribot.core.errors import ConfigError
from agribot.gis.geo_pyramid import read_geo, write_vrt
from agribot.gis.mbtiles import find_maps, read_tile

TILE_PX = 64
COLOURS = {(0, 0): (200, 0, 0), (0, 1): (0, 200, 0), (1, 0): (0, 0, 200), (1, 1): (200, 200, 0)}
SIZES = f"image_path: .\nimage_width: 128\nimage_height: 128\ntile_size: {TILE_PX}\n"
STEP_DEG = 2e-6
WEST_DEG, NORTH_DEG = 8.5, 50.0
ONE_TIE = (
    "// as in mapviz's own example\ndatum: wgs84\nprojection: geographic\n"
    f"tiepoint: [0, 0, {NORTH_DEG}, {WEST_DEG}]\npixel_scale: [{STEP_DEG}, {STEP_DEG}]\n"
)


def pyramid(folder: Path, place: str, suffix: str = "png") -> Path:
    layer = folder / "layer0"
    layer.mkdir(parents=True)
    for (row, column), rgb in COLOURS.items():
        picture = Image.new("RGB", (TILE_PX, TILE_PX), rgb)
        picture.save(layer / f"tile{row:05d}x{column:05d}.{suffix}")
    file = folder / "farm.geo"
    file.write_text(SIZES + place)
    return file


def colour_at(path: Path, zoom: int, lon_deg: float, lat_deg: float) -> tuple[int, ...]:
    """The pixel of the map's tiles at a place."""
    size = 2**zoom
    x = (lon_deg + 180.0) / 360.0 * size
    y = (1.0 - math.asinh(math.tan(math.radians(lat_deg))) / math.pi) / 2.0 * size
    data = read_tile(path, zoom, int(x), int(y))
    assert data is not None
    picture = Image.open(io.BytesIO(data)).convert("RGB")
    pixel = picture.getpixel((int(x % 1 * picture.width), int(y % 1 * picture.height)))
    assert isinstance(pixel, tuple)
    return pixel


@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_a_pyramid_is_imported_where_its_tie_point_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], suffix: str
) -> None:
    monkeypatch.setenv("AGRIBOT_HOME", str(tmp_path / "home"))
    file = pyramid(tmp_path / "images", ONE_TIE, suffix)
    assert main(["map", "--json", "import", str(file)]) == 0
    told = json.loads(capsys.readouterr().out)[0]
    path = find_maps(tmp_path / "home" / "maps")["farm"]
    for (row, column), rgb in COLOURS.items():
        lon_deg = WEST_DEG + (column + 0.5) * TILE_PX * STEP_DEG
        lat_deg = NORTH_DEG - (row + 0.5) * TILE_PX * STEP_DEG
        found = colour_at(path, told["maxzoom"], lon_deg, lat_deg)
        assert all(abs(a - b) < 20 for a, b in zip(found, rgb, strict=True)), (row, column)


def test_tie_points_in_metres_give_scale_and_place(tmp_path: Path) -> None:
    ties = [(0, 0, 500000.0, 5500000.0), (100, 0, 500020.0, 5500000.0), (0, 100, 5e5, 5499990.0)]
    place = "projection: utm\nzone: 32N\ntiepoints:\n" + "".join(
        f" - point: {list(tie)}\n" for tie in ties
    )
    found = read_geo(pyramid(tmp_path, place))
    assert found.srs == "EPSG:32632"
    assert found.world_from_pixel[0] == pytest.approx([0.2, 0.0, 500000.0], abs=1e-6)
    assert found.world_from_pixel[1] == pytest.approx([0.0, -0.1, 5500000.0], abs=1e-6)


@pytest.mark.parametrize(
    ("place", "why"),
    [
        ("projection: utm\ntiepoint: [0, 0, 1, 2]\npixel_scale: [1, 1]\n", "UTM zone"),
        ("projection: mars\n", "mars"),
        ("projection: wgs84\n", "tie points"),
        ("projection: wgs84\ntiepoint: [0, 0, 1, 2]\n", "pixel_scale"),
        ("projection: wgs84\ntiepoint: [0, 0, one, 2]\n", "four numbers"),
        ("projection: wgs84\ntiepoint: [0, 0, 1, 2]\npixel_scale: [a, 1]\n", "pixel_scale"),
        (
            "projection: wgs84\ntiepoints:\n - point: [0, 0, 8, 50]\n"
            " - point: [9, 0, 8, 51]\n - point: [0, 9, 9, 50]\n",
            "turned",
        ),
    ],
)
def test_a_picture_that_lies_nowhere_is_refused(tmp_path: Path, place: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        read_geo(pyramid(tmp_path, place))


def test_a_missing_tile_is_named(tmp_path: Path) -> None:
    file = pyramid(tmp_path, ONE_TIE)
    (tmp_path / "layer0" / "tile00001x00000.png").unlink()
    with pytest.raises(ConfigError, match="tile00001x00000"):
        write_vrt(read_geo(file), tmp_path / "farm.vrt")
