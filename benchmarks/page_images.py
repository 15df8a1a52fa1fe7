"""Makes the pictures of the operator's page in docs/images anew: every screen on the farm.

Three layouts in three themes, each one sheet, and the page beside a mission for the README.

python benchmarks/page_images.py [--out docs/images] [--single FOLDER]
"""

from __future__ import annotations

import argparse
import io
import shutil
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.ui.page.conftest import GL_ARGS, SCREENS, show, until
from tests.ui.page.robots import robot_with_page

THEMES = ("light", "dark", "sun")
# Viewport in px, pictures in a row of the sheet, and the width of one.
LAYOUTS = {
    "desktop": ((1280, 800), 3, 640),
    "tablet": ((820, 1180), 6, 320),
    "phone": ((390, 844), 6, 270),
}
README_PX = (1440, 900)
README_FROM = 0.6  # of the mission
GAP_PX, GAP_RGB = 10, (128, 128, 128)
PATIENCE_S = 900.0
SETTLING_S = 2.0  # a map without a graphics card
STATE = "window.__agribot.state()"


def opened(page: Page, address: str, theme: str, size: tuple[int, int]) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.goto(f"{address}/#/drive")
    page.evaluate(f"localStorage.setItem('theme', '{theme}')")
    page.evaluate("localStorage.setItem('operator', 'Ada')")
    page.reload()
    until(page, f"window.__agribot?.ready && {STATE}?.pose", PATIENCE_S)


def picture(page: Page) -> Image.Image:
    time.sleep(SETTLING_S)
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def pictures(page: Page) -> list[Image.Image]:
    """Every screen, and two of the things that open above one."""
    found = []
    for screen in SCREENS:
        show(page, screen)
        found.append(picture(page))
    show(page, "drive")
    page.get_by_role("button", name="Layers and views").click()
    found.append(picture(page))
    page.locator(".operator").click()
    found.append(picture(page))
    page.get_by_role("button", name="Close").last.click()
    return found


def sheet(made: list[Image.Image], columns: int, width_px: int) -> Image.Image:
    height_px = round(width_px * made[0].height / made[0].width)
    rows = -(-len(made) // columns)
    size = columns * (width_px + GAP_PX) + GAP_PX, rows * (height_px + GAP_PX) + GAP_PX
    whole = Image.new("RGB", size, GAP_RGB)
    for index, one in enumerate(made):
        row, column = divmod(index, columns)
        at = GAP_PX + column * (width_px + GAP_PX), GAP_PX + row * (height_px + GAP_PX)
        whole.paste(one.resize((width_px, height_px), Image.Resampling.LANCZOS), at)
    return whole


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/images"))
    parser.add_argument("--single", type=Path, help="every picture by itself as well, as PNG")
    options = parser.parse_args()
    out_dir = Path(tempfile.mkdtemp()) / "today-farm"
    with (
        robot_with_page("farm", out_dir, ["--set", "seed=1"]) as robot,
        sync_playwright() as playwright,
    ):
        chromium = shutil.which("chromium") or shutil.which("chromium-browser")
        browser = playwright.chromium.launch(executable_path=chromium, args=GL_ARGS)
        page = browser.new_page(locale="en", reduced_motion="reduce")
        page.set_default_timeout(1000 * PATIENCE_S)
        opened(page, robot.address, "light", README_PX)
        page.get_by_role("button", name="Take control").first.click()
        mission = f"{STATE}.mission"
        until(page, f"{mission}.s_m > {README_FROM} * {mission}.length_m", PATIENCE_S)
        picture(page).save(options.out / "page.webp", quality=82, method=6)
        for layout, (size, columns, width_px) in LAYOUTS.items():
            for theme in THEMES:
                opened(page, robot.address, theme, size)
                made = pictures(page)
                name = f"page-{layout}-{theme}"
                sheet(made, columns, width_px).save(
                    options.out / f"{name}.webp", quality=62, method=6
                )
                sys.stderr.write(f"{options.out / name}.webp\n")
                if options.single:
                    options.single.mkdir(parents=True, exist_ok=True)
                    for number, one in enumerate(made):
                        one.save(options.single / f"{name}-{number:02}.png")
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
