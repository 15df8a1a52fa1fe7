"""A program of the tests: print every help there is, and which heavy packages that has loaded."""

from __future__ import annotations

import contextlib
import io
import json
import sys

from agribot.cli.main import main
from tests.cli.parser_tree import every_parser

if __name__ == "__main__":
    heavy = set(sys.argv[1:])
    loaded: dict[str, list[str]] = {}
    for words in every_parser():
        with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
            main([*words, "--help"])
        loaded[" ".join(words)] = sorted(heavy & {name.split(".")[0] for name in sys.modules})
    sys.stdout.write(json.dumps(loaded) + "\n")
