"""The figures of a network on crop rows, as a model card states them."""

from __future__ import annotations

import msgspec

from agribot.lab.rows.judge import describe_line, format_value


class RowFigures(msgspec.Struct, frozen=True, kw_only=True):
    """Report of `agribot eval --data rows --json`; None where there is nothing to measure.

    `about` names the photographs.
    """

    about: str
    pictures: int
    on_rows: dict[str, float | None]
    between_rows: dict[str, float | None]
    balanced: float | None
    line: dict[str, float | None]

    def markdown(self) -> str:
        """Write a section of a card."""
        return f"""\
## Crop rows on {self.pictures} photographs, balanced {format_value(self.balanced, ".3f")}

By `agribot eval DIR --data rows`, on {self.about}.

| plants | called crop | weed | soil |
|---|---|---|---|
{_format_row("on rows", self.on_rows)}
{_format_row("between rows", self.between_rows)}

{describe_line(self.line).capitalize()}."""


def _format_row(name: str, shares: dict[str, float | None]) -> str:
    cells = (format_value(shares[kind], ".3f") for kind in ("crop", "weed", "soil"))
    return f"| {name} | {' | '.join(cells)} |"
