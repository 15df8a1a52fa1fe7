"""The lines that a run ends with."""

from __future__ import annotations

from pathlib import Path

import msgspec

from agribot.cli.run.run_summary import format_summary
from agribot.core.implement.row_shares import TreatedShare
from agribot.record.report import Report, WeedReport

EMPTY = Report(profile="beet", seed=1, sensors="rtk", version="0", ok=True, reason="1 of 1 rows")


def summarise(weeds: WeedReport, folder: Path) -> list[str]:
    text = format_summary(msgspec.structs.replace(EMPTY, weeds=weeds), folder)
    return [line.strip() for line in text.splitlines()]


def test_the_summary_counts_weeds_in_the_row_apart_and_says_why_weeds_were_left(
    tmp_path: Path,
) -> None:
    weeds = WeedReport(
        truth=74, mapped=49, treated=46, treated_true=60, crops_hit=0,
        in_row=TreatedShare(of=22, treated=9, share=9 / 22),
        between_rows=TreatedShare(of=52, treated=51, share=51 / 52),
        left={"leaf of crop": 3}, untreated={"called crop": 9, "leaf of crop": 5},
    )  # fmt: skip
    lines = summarise(weeds, tmp_path)
    assert "weeds treated in the row 9 of 22, between the rows 51 of 52" in lines
    assert "mapped weeds left 3: 3 leaf of crop" in lines
    assert "weeds untreated 14: 9 called crop, 5 leaf of crop" in lines


def test_a_run_without_weeds_says_nothing_of_them(tmp_path: Path) -> None:
    assert not any("weed" in line for line in summarise(WeedReport(), tmp_path))
