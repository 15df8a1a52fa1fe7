"""A page in Chromium for some time: `python -m agribot.lab.bench.ui_browser URL SECONDS`.

Prints how much more memory its JavaScript holds at the end, garbage collected, as JSON. It needs
Playwright and Chromium; where one is missing it ends with status 1 and says so.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Sequence
from typing import Any

ARGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SETTLE_MS = 20_000.0


def _read_heap_bytes(session: Any) -> int:
    session.send("HeapProfiler.collectGarbage")
    metrics = session.send("Performance.getMetrics")["metrics"]
    return next(int(one["value"]) for one in metrics if one["name"] == "JSHeapUsedSize")


def main(words: Sequence[str]) -> int:
    url, seconds = words
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        chromium = None
    if chromium is None:
        sys.stderr.write("no page is measured: Playwright or Chromium is missing\n")
        return 1
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGS)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(f"{url}#/drive")
        session = page.context.new_cdp_session(page)
        session.send("Performance.enable")
        page.wait_for_timeout(SETTLE_MS)
        before = _read_heap_bytes(session)
        page.wait_for_timeout(1e3 * float(seconds))
        result = {"heap_bytes": before, "heap_growth_bytes": _read_heap_bytes(session) - before}
        browser.close()
    sys.stdout.write(json.dumps(result) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
