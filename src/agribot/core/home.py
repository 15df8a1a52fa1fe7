"""Where the program keeps what outlives its runs on this computer."""

from __future__ import annotations

import os
from pathlib import Path


def find_home() -> Path:
    """Return `$AGRIBOT_HOME`, or `.agribot` in the user's folder."""
    return Path(os.environ.get("AGRIBOT_HOME") or Path.home() / ".agribot")
