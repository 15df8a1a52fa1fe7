"""Rasters are drawn by what their numbers hold, not by the type of their pixels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agribot.cli.main import main
from tests.gis.test_map_import import UTM, find_colour, list_colours, maps, write_raster

__all__ = ["maps"]  # a fixture
warp = pytest.importorskip("rasterio.warp")
SIDE_PX = 128


def _make_picture() -> np.ndarray:
    """Return red, green and blue of brown soil with green plants, (3, 128, 128), 0 to 1."""
    rng = np.random.default_rng(2)
    soil, plant = np.array([0.55, 0.40, 0.28]), np.array([0.30, 0.62, 0.20])
    is_plant = rng.random((SIDE_PX // 8, SIDE_PX // 8)).repeat(8, 0).repeat(8, 1) < 0.3
    picture = np.where(is_plant[None], plant[:, None, None], soil[:, None, None])
    light = rng.uniform(0.1, 1.6, (SIDE_PX // 16, SIDE_PX // 16)).repeat(16, 0).repeat(16, 1)
    return np.clip(picture * light, 0.0, 1.0)


def _import(path: Path, bands: Any, **more: object) -> np.ndarray:
    """Import a raster and return all pixels of its map, (N, 4)."""
    write_raster(path, list(bands), **more)  # type: ignore[arg-type]
    assert main(["map", "import", str(path)]) == 0
    return list_colours(path.parent / "home" / "maps" / f"{path.stem}.mbtiles").astype(float)


def _mean_colour(pixels: np.ndarray) -> np.ndarray:
    mean: np.ndarray = pixels[pixels[:, 3] > 250][:, :3].mean(axis=0)
    return mean


@pytest.mark.parametrize(
    ("kind", "scale", "offset"),
    [
        (np.uint16, 4095, 0), (np.uint16, 16383, 0), (np.uint16, 65535, 0), (np.uint16, 3000, 0),
        (np.uint16, 10000, 1000), (np.int16, 10000, 0), (np.int16, 20000, -10000),
        (np.float32, 1, 0), (np.float32, 255, 0), (np.float64, 65535, 0),
    ],
)  # fmt: skip
def test_a_picture_looks_the_same_however_its_numbers_are_stored(
    kind: Any, scale: float, offset: float, tmp_path: Path
) -> None:
    picture = _make_picture()
    plain = _import(tmp_path / "bytes.tif", (picture * 255).astype(np.uint8))
    stored = _import(tmp_path / "stored.tif", (picture * scale + offset).astype(kind))
    assert _mean_colour(plain) == pytest.approx((96, 99, 52), abs=3)
    # The 2nd percentile of these pixels is 13.2 of 255, the 98th 212.9.
    stretched = (_mean_colour(plain) - 13.2) * 255.0 / (212.9 - 13.2)
    assert _mean_colour(stored) == pytest.approx(stretched, abs=4)
    assert (stored[:, 3] > 250).sum() == (plain[:, 3] > 250).sum()


def test_what_is_drawn_black_and_white_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    values = np.linspace(100, 1100, SIDE_PX**2).round().reshape(SIDE_PX, SIDE_PX).astype(np.uint16)
    _import(tmp_path / "bits.tif", [values] * 3)
    assert "its uint16 pixels are drawn from 120 (black) to 1080 (white)" in capsys.readouterr().err


def test_near_infrared_that_is_marked_as_alpha_is_left_out_and_the_picture_is_opaque(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """GDAL's default mark for a fourth band without a colour interpretation."""
    picture = (_make_picture() * 255).astype(np.uint8)
    infrared = np.random.default_rng(4).integers(60, 220, (1, SIDE_PX, SIDE_PX), dtype=np.uint8)
    overexposed = np.where(infrared > 120, 255, infrared).astype(np.uint8)
    plain = _import(tmp_path / "plain.tif", picture)
    for name, band in (("nir", infrared), ("bright", overexposed)):
        pixels = _import(tmp_path / f"{name}.tif", np.concatenate([picture, band]))
        assert "band 4 is marked as alpha" in capsys.readouterr().err
        assert pixels == pytest.approx(plain, abs=1)
    picture[:, :, :64], infrared[:, :, :64] = 0, 0
    edged = _import(tmp_path / "edged.tif", np.concatenate([picture, infrared]))
    assert (edged[:, 3] > 250).sum() == pytest.approx(0.5 * (plain[:, 3] > 250).sum(), rel=0.05)


@pytest.mark.parametrize(("kind", "top"), [(np.uint8, 255), (np.uint16, 255), (np.uint16, 65535)])
def test_an_alpha_band_with_soft_edges_stays_one(kind: Any, top: int, tmp_path: Path) -> None:
    from rasterio.enums import ColorInterp

    picture = (_make_picture() * 255).astype(kind)
    alpha = np.clip(np.linspace(-1.0, 3.0, SIDE_PX), 0.0, 1.0) * top
    band = np.tile(alpha.astype(kind), (1, SIDE_PX, 1))
    kinds = (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)
    pixels = _import(tmp_path / "soft.tif", np.concatenate([picture, band]), colours=kinds)
    plain = _import(tmp_path / "plain.tif", picture)
    assert (pixels[:, 3] > 250).sum() == pytest.approx(0.5 * (plain[:, 3] > 250).sum(), rel=0.1)
    assert ((pixels[:, 3] > 20) & (pixels[:, 3] < 230)).any()


@pytest.mark.parametrize(
    ("kind", "nodata", "is_stated"),
    [
        (np.float32, -9999.0, True), (np.float32, -10000.0, False), (np.float32, np.nan, True),
        (np.float32, np.nan, False), (np.float32, float(np.finfo(np.float32).min), False),
        (np.float32, -3.4e38, False), (np.float32, 1e20, False), (np.int16, -10000, False),
        (np.uint16, 65535, True), (np.uint16, 65535, False),
    ],
)  # fmt: skip
def test_numbers_for_no_data_are_transparent_and_darken_nothing(
    kind: Any, nodata: float, is_stated: bool, tmp_path: Path
) -> None:
    picture = (_make_picture() * (0.4 if kind is np.float32 else 4095)).astype(kind)
    whole = _import(tmp_path / "whole.tif", picture)
    picture[:, :, : SIDE_PX // 2] = nodata
    pixels = _import(tmp_path / "half.tif", picture, **({"nodata": nodata} if is_stated else {}))
    shown = (pixels[:, 3] > 250).sum() / (whole[:, 3] > 250).sum()
    assert shown == pytest.approx(0.5, abs=0.03)
    assert _mean_colour(pixels) == pytest.approx(_mean_colour(whole), abs=15)


def test_a_dark_pixel_of_one_colour_is_data_where_nodata_is_zero(tmp_path: Path) -> None:
    picture = np.full((3, SIDE_PX, SIDE_PX), 90, dtype=np.uint8)
    picture[0] = 0
    picture[:, :, : SIDE_PX // 2] = 0
    pixels = _import(tmp_path / "zero.tif", picture, nodata=0)
    assert _mean_colour(pixels) == pytest.approx((0, 90, 90), abs=6)


def _make_ground(noise_m: float) -> np.ndarray:
    rng = np.random.default_rng(5)
    slope = np.linspace(0.0, 12.0, SIDE_PX)
    return (180.0 + slope[None, :] + rng.normal(0.0, noise_m, (SIDE_PX, SIDE_PX)))[None]


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("field", _make_ground(0.02).astype(np.float32)),
        ("field", _make_ground(0.02).round().astype(np.int16)),
        ("flat", (_make_ground(0.02) / 12.0).astype(np.float32)),
        ("farm_dsm", _make_ground(2.0).astype(np.float32)),
        ("DEM-2026", (10.0 * _make_ground(2.0)).astype(np.uint16)),
    ],
)
def test_heights_are_refused_with_the_way_to_draw_them(
    name: str, values: np.ndarray, tmp_path: Path, maps: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_raster(tmp_path / f"{name}.tif", list(values))
    assert main(["map", "import", str(tmp_path / f"{name}.tif")]) == 2
    said = capsys.readouterr().err
    assert f"{name}.tif holds heights" in said
    assert f"gdaldem hillshade {name}.tif" in said
    assert not list(maps.glob("*"))


def test_a_grey_picture_of_floats_and_an_index_of_plants_are_drawn(tmp_path: Path) -> None:
    picture = _make_picture()
    grey = picture.mean(axis=0, keepdims=True)
    index = (picture[1:2] - picture[0:1]) / (picture[1:2] + picture[0:1])
    for name, values in (("grey", grey * 255), ("index", index)):
        pixels = _import(tmp_path / f"{name}.tif", values.astype(np.float32))
        shown = pixels[pixels[:, 3] > 250]
        assert shown[:, 0].min() < 20 and shown[:, 0].max() > 235
        assert np.ptp(shown[:, :3], axis=1).max() < 12, "grey"


def test_the_colours_of_a_multispectral_picture_are_found_by_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import rasterio

    red, green, blue = (_make_picture() * 10000).astype(np.uint16)
    path = tmp_path / "five.tif"
    write_raster(path, [blue, green, red, green + red, red], photometric="minisblack")
    with rasterio.open(path, "r+") as raster:
        raster.descriptions = ("Blue", "Green", "Red", "NIR", "Red edge")
    assert main(["map", "import", str(path)]) == 0
    assert "bands 3, 2, 1 of 5 are drawn" in capsys.readouterr().err
    found = _mean_colour(list_colours(tmp_path / "home" / "maps" / "five.mbtiles").astype(float))
    plain = _import(tmp_path / "plain.tif", np.stack([red, green, blue]))
    assert found == pytest.approx(_mean_colour(plain), abs=1)


def test_an_alpha_band_that_stands_first_and_a_mask_inside_the_file_are_obeyed(
    tmp_path: Path,
) -> None:
    import rasterio
    from rasterio.enums import ColorInterp

    picture = np.clip(_make_picture() * 255, 1, 255).astype(np.uint8)
    shown = np.zeros((1, SIDE_PX, SIDE_PX), dtype=np.uint8)
    shown[:, :, : SIDE_PX // 4] = 255
    kinds = (ColorInterp.alpha, ColorInterp.red, ColorInterp.green, ColorInterp.blue)
    first = _import(tmp_path / "first.tif", np.concatenate([shown, picture]), colours=kinds)
    path = tmp_path / "mask.tif"
    write_raster(path, list(picture))
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True), rasterio.open(path, "r+") as raster:
        raster.write_mask(shown[0])
    assert main(["map", "import", str(path)]) == 0
    masked = list_colours(tmp_path / "home" / "maps" / "mask.mbtiles").astype(float)
    whole = _import(tmp_path / "whole.tif", picture)
    for pixels in (first, masked):
        assert (pixels[:, 3] > 250).sum() == pytest.approx(
            0.25 * (whole[:, 3] > 250).sum(), rel=0.1
        )
        assert _mean_colour(pixels)[1] == pytest.approx(_mean_colour(whole)[1], abs=25)


@pytest.mark.parametrize("turn_deg", [0.0, 30.0, 60.0, 180.0])
@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_a_picture_that_is_turned_lies_where_its_corners_say(
    turn_deg: float, kind: Any, tmp_path: Path
) -> None:
    import rasterio

    turn_rad = np.radians(turn_deg)
    right_m = 10.0 * np.array([np.cos(turn_rad), np.sin(turn_rad)])  # of a pixel
    down_m = 10.0 * np.array([np.sin(turn_rad), -np.cos(turn_rad)])
    corner_m = np.array([270_640.0, 2_341_360.0]) - 64 * right_m - 64 * down_m
    columns = (right_m[0], down_m[0], corner_m[0], right_m[1], down_m[1], corner_m[1])
    place = rasterio.Affine(*columns)
    picture = (np.clip(_make_picture(), 0.2, 0.7) * 200).astype(kind)
    picture[:, 100:110, 20:30] = np.array([250, 10, 10], dtype=kind)[:, None, None]
    write_raster(tmp_path / "turned.tif", list(picture), transform=place)
    assert main(["map", "import", str(tmp_path / "turned.tif")]) == 0
    east_m, north_m = corner_m + 25 * right_m + 105 * down_m
    (lon_deg,), (lat_deg,) = warp.transform(UTM, "EPSG:4326", [east_m], [north_m])
    colour = find_colour(tmp_path / "home" / "maps" / "turned.mbtiles", lat_deg, lon_deg)
    assert colour[0] > 200 and max(colour[1:3]) < 60
