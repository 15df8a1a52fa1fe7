"""Makes the pictures of the operator's page in docs/images anew: every screen on the farm.

A sheet of each layout in a theme, and the page beside a mission for the README.

python benchmarks/page_images.py [--out docs/images] [--single FOLDER]
"""

from __future__ import annotations

import argparse
import io
import shutil
import sys
import tempfile
import time
from contextlib import ExitStack, suppress
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.ui.page.conftest import GL_ARGS, SCREENS, show, until
from tests.ui.page.robots import robot_with_page

# Theme, viewport in px, pictures in a row of the sheet, and the width of one.
LAYOUTS = {
    "desktop": ("light", (1280, 800), 3, 640),
    "tablet": ("sun", (820, 1180), 6, 320),
    "phone": ("dark", (390, 844), 6, 270),
}
README_PX = (1440, 900)
# A camera that leaves a small machine some time for its browser.
SETTINGS = ["--set", "seed=1", "--set", "perception.camera_rate_hz=4"]
README_FROM = 0.5  # share of the mission
PACE = 1.0  # simulated over real time
GAP_PX, GAP_RGB = 10, (128, 128, 128)
PATIENCE_S = 900.0
LOADING_S, SETTLING_S = 120.0, 3.0  # a map without a graphics card
MAP_S = 30.0  # until it has drawn everything
DRIVES_MPS = 0.2  # speed from which on the robot counts as driving again
STATE = "window.__agribot.state()"
READY = (
    "[...document.querySelectorAll('.banner.bad')].every(each => !each.offsetParent)",
    "!document.querySelector('.screen .map') || window.__agribot.map?.areTilesLoaded()",
    """[...document.querySelectorAll('.picture-label')]
        .every(each => !each.offsetParent || /ms/.test(each.textContent))""",
)


def open_page(page: Page, address: str, theme: str, size: tuple[int, int]) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.goto(f"{address}/#/drive")
    page.evaluate(f"localStorage.setItem('theme', '{theme}')")
    page.evaluate("localStorage.setItem('operator', 'Ada')")
    page.reload()
    until(page, f"window.__agribot?.ready && {STATE}?.pose", PATIENCE_S)


def take_picture(page: Page) -> Image.Image:
    """Once everything on the screen has been there; a busy machine may lose some of it again."""
    for what in READY:
        with suppress(AssertionError):
            until(page, what, LOADING_S)
    time.sleep(SETTLING_S)
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def take_pictures(page: Page) -> list[Image.Image]:
    """Every screen, and two of the things that open above one."""
    found = []
    for screen in SCREENS:
        show(page, screen)
        found.append(take_picture(page))
        sys.stderr.write(f"{screen}\n")
    show(page, "drive")
    page.get_by_role("button", name="Layers and views").click()
    found.append(take_picture(page))
    page.locator(".operator").click()
    found.append(take_picture(page))
    page.get_by_role("button", name="Close").last.click()
    return found


def make_sheet(made: list[Image.Image], columns: int, width_px: int) -> Image.Image:
    height_px = round(width_px * made[0].height / made[0].width)
    rows = -(-len(made) // columns)
    size = columns * (width_px + GAP_PX) + GAP_PX, rows * (height_px + GAP_PX) + GAP_PX
    whole = Image.new("RGB", size, GAP_RGB)
    for index, one in enumerate(made):
        row, column = divmod(index, columns)
        at = GAP_PX + column * (width_px + GAP_PX), GAP_PX + row * (height_px + GAP_PX)
        whole.paste(one.resize((width_px, height_px), Image.Resampling.LANCZOS), at)
    return whole


def make_sheets(
    page: Page, address: str, layouts: list[str], out: Path, single: Path | None
) -> None:
    for layout in layouts:
        theme, size, columns, width_px = LAYOUTS[layout]
        open_page(page, address, theme, size)
        made = take_pictures(page)
        name = f"page-{layout}-{theme}"
        make_sheet(made, columns, width_px).save(out / f"{name}.webp", quality=62, method=6)
        sys.stderr.write(f"{out / name}.webp\n")
        if single:
            single.mkdir(parents=True, exist_ok=True)
            for number, one in enumerate(made):
                one.save(single / f"{name}-{number:02}.png")


def take_mission_picture(page: Page, address: str) -> Image.Image:
    """Of the page beside the robot at work; until then on a screen that costs little.

    The robot waits while a slow machine draws the map.
    """
    open_page(page, address, "light", README_PX)
    page.get_by_role("button", name="Take control").first.click()
    show(page, "health")
    mission = f"{STATE}.mission"
    until(page, f"{mission}.s_m > {README_FROM} * {mission}.length_m", PATIENCE_S)
    show(page, "drive")
    page.get_by_role("button", name="Pause").click()
    until(page, f"{mission}.state === 'paused'", PATIENCE_S)
    take_picture(page)
    time.sleep(MAP_S)
    page.get_by_role("button", name="Resume").click()
    until(page, f"{mission}.state === 'running' && {STATE}.v_mps > {DRIVES_MPS}", PATIENCE_S)
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/images"))
    parser.add_argument("--single", type=Path, help="every picture by itself as well, as PNG")
    parser.add_argument("--layout", action="append", choices=LAYOUTS, help="this one alone")
    parser.add_argument("--no-sheets", action="store_true", help="the page beside a mission alone")
    parser.add_argument("--at", help="address of a robot that is there already: the sheets alone")
    options = parser.parse_args()
    with ExitStack() as parts:
        chromium = shutil.which("chromium-headless-shell") or shutil.which("chromium")
        playwright = parts.enter_context(sync_playwright())
        browser = playwright.chromium.launch(executable_path=chromium, args=GL_ARGS)
        page = browser.new_page(locale="en", reduced_motion="reduce")
        page.set_default_timeout(1000 * PATIENCE_S)
        address = options.at
        if address is None:
            out_dir = Path(tempfile.mkdtemp()) / "today-farm"
            robot = parts.enter_context(robot_with_page("farm", out_dir, SETTINGS, pace=PACE))
            address = robot.address
            made = take_mission_picture(page, address)
            made.save(options.out / "page.webp", quality=82, method=6)
        layouts = [] if options.no_sheets else options.layout or list(LAYOUTS)
        make_sheets(page, address, layouts, options.out, options.single)
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
