"""What the operator's page costs in a browser: panning over many weeds, and memory over time.

Chromium draws the built page of a made-up robot; without a graphics card the frame rate is that
of the software renderer, the main thread's time per frame is the page's own.

python benchmarks/page.py [--weeds 50000] [--pan-s 10] [--watch-s 300]
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import CDPSession, Page, sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.ui.page.conftest import GL_ARGS, until
from tests.ui.page.fake_server import STATE_HZ, FakeServer, serving

READY_S = 60.0
# Circles, a little each frame, as a finger does; frames are counted where they are drawn.
PAN = """seconds => new Promise(done => {
  const map = window.__agribot.map, frames = [], began = performance.now()
  let last = began
  const step = now => {
    frames.push(now - last)
    last = now
    if (now - began > 1000 * seconds) return done(frames.slice(1))
    const turn = now / 700
    map.panBy([6 * Math.cos(turn), 6 * Math.sin(turn)], {animate: false})
    requestAnimationFrame(step)
  }
  requestAnimationFrame(step)
})"""


def measure(weeds: int, pan_s: float, watch_s: float) -> dict[str, Any]:
    server = FakeServer(weeds, state_hz=STATE_HZ)
    with serving(server) as address, sync_playwright() as playwright:
        chromium = shutil.which("chromium") or shutil.which("chromium-browser")
        browser = playwright.chromium.launch(executable_path=chromium, args=GL_ARGS)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(f"{address}/#/weeds")
        until(page, f"window.__agribot?.counters.weeds >= {weeds}", READY_S)
        until(page, "window.__agribot.map?.getLayer('weeds')", READY_S)
        time.sleep(5.0)
        tools = page.context.new_cdp_session(page)
        tools.send("Performance.enable", {"timeDomain": "threadTicks"})
        found = {"weeds": weeds, **_pan(page, tools, pan_s)}
        page.evaluate("location.hash = '#/drive'")
        time.sleep(5.0)
        before, _ = _read_heap_bytes(tools), time.sleep(watch_s)
        after = _read_heap_bytes(tools)
        browser.close()
    return {**found, "watched_s": watch_s, "heap_bytes": after, "heap_growth_bytes": after - before}


def _pan(page: Page, tools: CDPSession, seconds: float) -> dict[str, Any]:
    began_s = _read_busy_s(tools)
    time.sleep(seconds)
    still_s = _read_busy_s(tools) - began_s
    began_s = _read_busy_s(tools)
    frames_ms = sorted(page.evaluate(PAN, seconds))
    busy_s = _read_busy_s(tools) - began_s
    return {
        "frames": len(frames_ms),
        "frame_p50_ms": round(frames_ms[len(frames_ms) // 2], 1),
        "frame_p95_ms": round(frames_ms[int(0.95 * len(frames_ms))], 1),
        "main_thread_standing_ratio": round(still_s / seconds, 3),
        "main_thread_panning_ratio": round(busy_s / seconds, 3),
        "main_thread_ms_per_frame": round(1e3 * max(0.0, busy_s - still_s) / len(frames_ms), 2),
    }


def _read_busy_s(tools: CDPSession) -> float:
    """CPU time of the page's main thread until now, s."""
    metrics = tools.send("Performance.getMetrics")["metrics"]
    return float(next(one["value"] for one in metrics if one["name"] == "TaskDuration"))


def _read_heap_bytes(tools: CDPSession) -> int:
    for _ in range(2):
        tools.send("HeapProfiler.collectGarbage")
    return int(tools.send("Runtime.getHeapUsage")["usedSize"])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--weeds", type=int, default=50_000)
    parser.add_argument("--pan-s", type=float, default=10.0)
    parser.add_argument("--watch-s", type=float, default=300.0)
    options = parser.parse_args()
    sys.stdout.write(json.dumps(measure(options.weeds, options.pan_s, options.watch_s)) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
