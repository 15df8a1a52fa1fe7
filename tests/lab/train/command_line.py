"""The words of `agribot train`, read as the command reads them."""

from __future__ import annotations

import argparse

from agribot.cli.data.train import add_arguments


def parsed(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return parser.parse_args(words)
