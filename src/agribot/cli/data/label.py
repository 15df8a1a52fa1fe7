"""`agribot label`: a page on which the network's guesses are corrected, picture after picture."""

from __future__ import annotations

import argparse
import sys
import threading
import webbrowser
from pathlib import Path

from agribot.cli.ids_option import add_ids_option
from agribot.cli.ranges import port, threads
from agribot.cli.stopping import stop_on_signal
from agribot.core import extras
from agribot.core.config import DEFAULT_MODEL

LOOK_S = 0.2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "folder", type=Path, metavar="DIR", help="its folder 'images' holds the photographs"
    )
    parser.add_argument(
        "--model", default=DEFAULT_MODEL, help="network that labels first: name, or .onnx file"
    )
    parser.add_argument("--size", help="another input size for the network, WxH px")
    add_ids_option(parser)
    parser.add_argument("--threads", type=threads, default=1)
    parser.add_argument(
        "--port", type=port, metavar="P", help="of the page (default: the first free one from 8080)"
    )
    parser.add_argument("--open", action="store_true", help="open the page in a browser")


def run(options: argparse.Namespace) -> int:
    """Serve the page until somebody interrupts.

    Raises: ConfigError: no photographs, or the port is taken. PerceptionError: no such network.
    """
    extras.require("ui", "agribot label")
    from agribot.lab.dataset.classes import read_ids
    from agribot.lab.labelling.guesses import guess_picture
    from agribot.lab.labelling.label_folder import LabelFolder
    from agribot.lab.train.networks import open_network
    from agribot.ui.server.label_page import serve_labels

    ids = read_ids(options.ids)
    segmenter = open_network(options.model, options.threads, options.size)
    labels = LabelFolder(
        options.folder, lambda image_rgb: guess_picture(segmenter, image_rgb), options.model, ids
    )
    for reason, name in labels.left_out:
        sys.stderr.write(f"left out: {name}: {reason}\n")
    ended = threading.Event()
    with stop_on_signal() as stop, serve_labels(labels, options.port) as url:
        judging = threading.Thread(target=labels.judge_all, args=(ended.is_set,), daemon=True)
        judging.start()
        sys.stderr.write(f"page: {url}\nlabel: Ctrl-C ends; all that was drawn is saved\n")
        sys.stderr.flush()
        if options.open:
            webbrowser.open(url)
        while not stop:
            ended.wait(LOOK_S)
        ended.set()
        judging.join()
    done = sum(one.state == "done" for one in labels.list_pictures())
    sys.stderr.write(f"{done} of {len(labels.list_pictures())} pictures are labelled\n")
    return 0
