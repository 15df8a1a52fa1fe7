"""The wiring page names the pins of the motor board's program."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PINS = ROOT / "firmware" / "motor_board" / "pins.h"
# Ranges that the page writes out, and the program's comments do not.
SPELLED = {"D22 to D25": "D22, D23, D24, D25", "A1 to A4": "A1, A2, A3, A4"}

if PINS.exists():  # a tree without the board's program has nothing to compare

    def test_every_pin_of_the_board_is_on_the_page_and_no_other() -> None:
        page = (ROOT / "docs" / "wiring.md").read_text("utf-8")
        comments = " ".join(re.findall(r"/\*(.*?)\*/", PINS.read_text("utf-8"), re.DOTALL))
        for range_of, pins in SPELLED.items():
            comments = comments.replace(range_of, pins)
        known = set(re.findall(r"\b[DA]\d+\b", comments)) | {"D30"}  # bit 7 of the tool
        assert set(re.findall(r"\b[DA]\d+\b", page)) == known
