"""`agribot models`: list the networks and what their cards say."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from agribot.autonomy.perceive.segmenter import model_names, model_path
from agribot.core.config import DEFAULT_MODEL
from agribot.lab.train.networks import read_card


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", help="a name, or a path to an .onnx file: its card")
    parser.add_argument("--json", action="store_true", help="print the cards as the last line")


def run(args: argparse.Namespace) -> int:
    """List the networks, or show one.

    Raises: PerceptionError: no such network.
    """
    if args.name:
        return _show_card(args)
    cards = {name: read_card(name) for name in model_names()}
    for name, card in cards.items():
        sys.stderr.write(format_line(name, card) + "\n")
    if args.json:
        sys.stdout.write(json.dumps({"default": DEFAULT_MODEL, "models": cards}) + "\n")
    return 0


def _show_card(args: argparse.Namespace) -> int:
    path = model_path(args.name)
    text = path.with_suffix(".md")
    if text.is_file():
        sys.stderr.write(text.read_text(encoding="utf-8"))
    else:
        sys.stderr.write(f"{path} has no card beside it\n")
    if args.json:
        sys.stdout.write(json.dumps(read_card(args.name)) + "\n")
    return 0


def format_line(name: str, card: dict[str, Any]) -> str:
    if not card:
        return f"{name}: no card"
    held_out = card.get("held_out") or {}
    scored = held_out.get("test") or card.get("test", {})
    tests = ", ".join(f"{test} {s['miou']:.3f}" for test, s in scored.items())
    if held_out:
        tests += f" (of the same recipe on {held_out['train_images']} images)"
    mark = " (default)" if name == DEFAULT_MODEL else ""
    return (
        f"{name}{mark}: {card['license']}; {card['input_width_px']}x{card['input_height_px']}, "
        f"{card['parameters'] / 1e6:.2f} M parameters; mIoU {tests or 'not measured'}"
    )
