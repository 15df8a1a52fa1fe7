"""`python -m agribot`: the program `agribot`, where its own name is not in the PATH."""

from __future__ import annotations

import sys

from agribot.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
