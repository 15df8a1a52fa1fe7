"""Makes docs/images/label.webp anew: the page of `agribot label` on drawn photographs.

python benchmarks/label_image.py [--out docs/images/label.webp]
"""

from __future__ import annotations

import argparse
import io
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, expect, sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.ui.page.conftest import GL_ARGS

SIZE_PX = (1400, 850)
PICTURES = 4
# Of the photograph, from its top left: a plant that the pointer rests on.
POINTER_RATIO = (0.45, 0.5)
GUESS_MS = 120_000  # longest time for the first guesses of the network
AGRIBOT = (sys.executable, "-m", "agribot.cli")


def draw_photographs(folder: Path) -> None:
    """Draw photographs, and leave out the masks that they come with."""
    words = ("--images", str(PICTURES), "--views", "1", "--seed", "1", "--out", str(folder))
    subprocess.run([*AGRIBOT, "dataset", "generate", *words], check=True)
    shutil.rmtree(folder / "masks")


@contextmanager
def serve_page(folder: Path) -> Iterator[str]:
    """Serve the page of the photographs; yields its address."""
    process = subprocess.Popen(
        [*AGRIBOT, "label", str(folder), "--port", "0"],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        lines = (re.search(r"http://127\.0\.0\.1:\d+\S*", line) for line in process.stdout)
        yield next(found[0] for found in lines if found)
    finally:
        process.terminate()
        process.wait()


def take_picture(page: Page, address: str) -> Image.Image:
    """Take the page once the network has looked at each picture."""
    page.goto(address)
    judged = page.locator(".picture-list li", has_text="%")
    expect(judged).to_have_count(PICTURES, timeout=GUESS_MS)
    page.wait_for_load_state("networkidle")
    box = page.locator(".overlay").bounding_box()
    assert box
    right, down = POINTER_RATIO
    page.mouse.move(box["x"] + right * box["width"], box["y"] + down * box["height"])
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/images/label.webp"))
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp()) / "photos"
    draw_photographs(folder)
    with serve_page(folder) as address, sync_playwright() as playwright:
        chromium = shutil.which("chromium-headless-shell") or shutil.which("chromium")
        browser = playwright.chromium.launch(executable_path=chromium, args=GL_ARGS)
        page = browser.new_page(locale="en", viewport={"width": SIZE_PX[0], "height": SIZE_PX[1]})
        take_picture(page, address).save(options.out, quality=82, method=6)
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
