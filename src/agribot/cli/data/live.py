"""`agribot live`: run a camera, a video or the simulator through the network."""

from __future__ import annotations

import argparse
import json
import sys
import time
import webbrowser
from collections import deque
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agribot.cli.data.live_overlay import draw_notice, draw_overlay
from agribot.cli.data.newest_frame import EveryFrame, Frames, FrameSource, NewestFrame
from agribot.cli.ranges import check_above, finite, port, seed, threads, whole
from agribot.cli.standard_error import print_line
from agribot.cli.stopping import stop_on_signal
from agribot.core.config import DEFAULT_MODEL
from agribot.core.errors import ConfigError, PerceptionError

if TYPE_CHECKING:
    from agribot.ui.server.live_page import LivePage

LINE_EVERY_S = 1.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source",
        help="sim, number of a webcam, path of a video, address such as rtsp://..., or topic of "
        "pictures: ros1:/usb_cam/image_raw, ros2:/image, ros2://HOST:PORT/image",
    )
    parser.add_argument("--model", default=DEFAULT_MODEL, help="name, or path to an .onnx file")
    parser.add_argument("--size", help="another input size for the network, WxH px")
    parser.add_argument("--seconds", type=finite, help="stop after this time (default: never)")
    parser.add_argument(
        "--every",
        type=whole(1),
        metavar="N",
        help="of a file: look at the first frame and at every Nth (default: at all of them)",
    )
    parser.add_argument("--patience", type=finite, default=5.0, help="s without frame to give up")
    parser.add_argument("--provider", choices=("cpu", "cuda", "tensorrt"), default="cpu")
    parser.add_argument("--threads", type=threads, default=2)
    parser.add_argument("--seed", type=seed, default=0, help="sim: weeds and camera noise")
    parser.add_argument("--out", type=Path, help="folder that gets latest.jpg, once a second")
    parser.add_argument(
        "--show", action="store_true", help="serve a page with the network's classes in the picture"
    )
    parser.add_argument(
        "--port", type=port, metavar="P", help="--show: of the page (default: a free one from 8080)"
    )
    parser.add_argument("--open", action="store_true", help="--show: open the page in a browser")
    parser.add_argument("--json", action="store_true", help="print a summary as the last line")


class Meter:
    """Frames per second over the last second, latency from capture to class map."""

    def __init__(self) -> None:
        self._ends_s: deque[float] = deque()
        self.latencies_s: list[float] = []
        self.started_s = time.monotonic()

    def note(self, captured_s: float, done_s: float) -> None:
        self.latencies_s.append(done_s - captured_s)
        self._ends_s.append(done_s)
        while done_s - self._ends_s[0] > 1.0:
            self._ends_s.popleft()

    @property
    def fps(self) -> float:
        if len(self._ends_s) < 2:
            return 0.0
        return (len(self._ends_s) - 1) / (self._ends_s[-1] - self._ends_s[0])

    def summary(self) -> dict[str, Any]:
        ordered = sorted(self.latencies_s)
        lasted_s = time.monotonic() - self.started_s

        def at(share: float) -> float | None:
            return ordered[int(share * (len(ordered) - 1))] if ordered else None

        return {
            "frames": len(ordered),
            "fps": len(ordered) / lasted_s if ordered else None,
            "latency_median_s": at(0.5),
            "latency_p95_s": at(0.95),
        }


def run(args: argparse.Namespace) -> int:
    """Return 1 where the camera stopped or gave no frame, 130 after Ctrl-C.

    Raises: ConfigError: an option out of range; PerceptionError: the source does not open.
    """
    check_above("--patience", args.patience, 0.0)
    if args.seconds is not None:
        check_above("--seconds", args.seconds, 0.0)
    from agribot.lab.train.networks import open_network

    segmenter = open_network(args.model, args.threads, args.size, args.provider)
    fault = ""
    with stop_on_signal() as stop, _open_page(args) as page:
        frames = choose_frames(open_source(args.source, args.seed), args, stop)
        meter = Meter()
        try:
            _watch(frames, segmenter, meter, (args.out, page), stop)
        except PerceptionError as error:
            fault = str(error)
            sys.stderr.write(f"agribot live: {fault}\n")
        if page is not None:
            page.close(draw_notice(fault or "agribot live has ended"))
    summary = {
        "source": args.source,
        "model": args.model,
        **meter.summary(),
        "captured": frames.captured,
        "dropped": frames.dropped,
        "fault": fault or None,
    }
    dropped = f", {frames.dropped} dropped for a newer one" if frames.dropped else ""
    sys.stderr.write(f"{summary['frames']} of {frames.captured} frames seen{dropped}\n")
    if args.json:
        sys.stdout.write(json.dumps(summary) + "\n")
    return 130 if stop else 1 if fault or not summary["frames"] else 0


def choose_frames(source: FrameSource, args: argparse.Namespace, stop: list[int]) -> Frames:
    """Take every frame of a file, and the newest one of a camera until `stop` holds a signal.

    Raises: ConfigError: --every of a camera.
    """
    if source.is_file:
        return EveryFrame(source, args.every or 1, args.seconds)
    if args.every is not None:
        source.close()
        raise ConfigError(
            f"--every is for files; {source.name} is always looked at in its newest frame"
        )
    return NewestFrame(source, args.patience, args.seconds, lambda: bool(stop))


def open_source(name: str, seed: int) -> FrameSource:
    from agribot.cli.data.live_sources import TOPICS, Capture, SimulatedDrive, TopicFrames

    if name == "sim":
        return SimulatedDrive(seed)
    return TopicFrames(name) if name.startswith(TOPICS) else Capture(name)


@contextmanager
def _open_page(args: argparse.Namespace) -> Iterator[LivePage | None]:
    """Serve the page of --show and print its address.

    Raises: ConfigError: the port is taken.
    """
    if not (args.show or args.open or args.port is not None):
        yield None
        return
    from agribot.ui.server.live_page import LivePage

    with closing(LivePage(args.port)) as page:
        page.show(draw_notice(f"waiting for the first picture of {args.source}"))
        print_line(f"page: {page.url} (Ctrl-C ends)")
        if args.open:
            webbrowser.open(page.url)
        yield page


def _watch(
    frames: Frames,
    segmenter: Any,
    meter: Meter,
    shown_on: tuple[Path | None, LivePage | None],
    stop: list[int],
) -> None:
    out, page = shown_on
    next_line_s = 0.0
    for frame in frames:
        seen = segmenter.segment(frame.image_rgb)
        done_s = time.monotonic()
        meter.note(frame.captured_s, done_s)
        is_due = done_s >= next_line_s
        words = _describe(meter, seen, frames.dropped)
        if is_due:
            next_line_s = done_s + LINE_EVERY_S
            sys.stderr.write(f"{words}\n")
        is_followed = page is not None and (is_due or page.viewers > 0)
        if is_followed or (is_due and out is not None):
            jpeg = draw_overlay(frame.image_rgb, seen, words)
            if page is not None:
                page.show(jpeg)
            if is_due and out is not None:
                _keep(jpeg, out)
        if stop:
            return


def _describe(meter: Meter, seen: Any, dropped: int) -> str:
    weed, crop = (float((seen.class_id == kind).mean()) for kind in (0, 1))
    return (
        f"{meter.fps:5.1f} fps  latency {1e3 * meter.latencies_s[-1]:5.1f} ms  dropped "
        f"{dropped}  weed {weed:.1%}  crop {crop:.1%}"
    )


def _keep(jpeg: bytes, out: Path) -> None:
    """Replace the newest overlay in the folder at once."""
    from agribot.core.whole_file import write_at_once

    out.mkdir(parents=True, exist_ok=True)
    write_at_once(out / "latest.jpg", jpeg)
