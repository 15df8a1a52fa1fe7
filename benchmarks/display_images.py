"""Makes docs/images/displays.webp anew: each display of the map with a topic of a real network.

Needs Chromium, for ROS 1 a roscore, for the others `agribot[ros,dds]`.

python benchmarks/display_images.py [--network ros1] [--single FOLDER] [--out FILE]
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont
from playwright.sync_api import sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.ros.messages.gallery_scene import make_gallery
from tests.ui.page.conftest import GL_ARGS
from tests.ui.page.display_gallery import FIELD, NETWORKS, SIZE_PX, TAPS, Gallery

COLUMNS, TILE_WIDTH_PX, GAP_PX = 4, 384, 8
TITLE_PX, TITLE_RGB = 18, (26, 33, 28)
MAPS = {"tile_map": 40.0, "multires_image": 11.0}  # sides of the squares that they show, m


def take_pictures(network: str, only: list[str]) -> dict[str, Image.Image]:
    """Take one of each display and tool, by its title."""
    made: dict[str, Image.Image] = {}
    chromium = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        os.environ["AGRIBOT_HOME"] = folder
        browser = playwright.chromium.launch(executable_path=chromium, args=GL_ARGS)
        with closing(Gallery(browser, network, Path(folder))) as gallery:
            for name, take in list_takes(gallery).items():
                if not only or name in only:
                    picture = take()
                    made[gallery.titles.get(name, name)] = picture
                    sys.stderr.write(f"{network} {name}\n")
        browser.close()
    return made


def list_takes(gallery: Gallery) -> dict[str, Callable[[], Image.Image]]:
    """List what takes each picture; maps come last, for they stay."""
    shown = {one.display: partial(gallery.show, one) for one in make_gallery(FIELD)}
    tools = {tool: partial(gallery.use, tool) for tool in TAPS}
    maps = {name: partial(gallery.show_map, name, side_m) for name, side_m in MAPS.items()}
    return {**shown, **tools, **maps}


def make_sheet(made: dict[str, Image.Image]) -> Image.Image:
    """Put the pictures side by side, each with its title below."""
    font = ImageFont.load_default(TITLE_PX)
    tile = TILE_WIDTH_PX, TILE_WIDTH_PX * SIZE_PX[1] // SIZE_PX[0]
    step = tile[0] + GAP_PX, tile[1] + TITLE_PX + 2 * GAP_PX
    rows = -(-len(made) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * step[0] + GAP_PX, rows * step[1] + GAP_PX), "white")
    pen = ImageDraw.Draw(sheet)
    for number, (title, picture) in enumerate(made.items()):
        row, column = divmod(number, COLUMNS)
        left, top = GAP_PX + column * step[0], GAP_PX + row * step[1]
        sheet.paste(picture.resize(tile, Image.Resampling.LANCZOS), (left, top))
        pen.text((left + tile[0] // 2, top + tile[1] + 2), title, TITLE_RGB, font, anchor="ma")
    return sheet


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--network", choices=NETWORKS, default="ros1")
    parser.add_argument("--only", action="append", default=[], metavar="DISPLAY")
    parser.add_argument("--single", type=Path, help="every picture by itself as well, as PNG")
    parser.add_argument("--out", type=Path, default=Path("docs/images/displays.webp"))
    options = parser.parse_args()
    made = take_pictures(options.network, options.only)
    if options.single:
        options.single.mkdir(parents=True, exist_ok=True)
        for title, picture in made.items():
            picture.save(options.single / f"{title}-{options.network}.png")
    if not options.only:
        make_sheet(made).save(options.out, quality=80, method=6)
    return 0


if __name__ == "__main__":
    sys.exit(main())
