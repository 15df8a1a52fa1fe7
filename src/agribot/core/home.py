"""Where the program keeps what outlives its runs on this computer."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path


def find_home() -> Path:
    """Return `$AGRIBOT_HOME`, or `.agribot` in the user's folder."""
    return Path(os.environ.get("AGRIBOT_HOME") or Path.home() / ".agribot")


def find_machine_file(folder: str, platform: str) -> Path:
    """Return the file of a machine, which its platform names, in a folder of the home."""
    digest = hashlib.sha256(platform.encode()).hexdigest()[:16]
    return find_home() / folder / f"{digest}.json"
