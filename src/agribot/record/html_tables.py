"""Tables of a report page."""

from __future__ import annotations

from html import escape

_OPEN_ROWS = 12  # rows of an open table; longer ones start folded


def render_table(heads: tuple[str, ...], body: list[list[str]]) -> str:
    head = "".join(
        f"<th{' class=left' if i == 0 else ''}>{escape(text)}</th>" for i, text in enumerate(heads)
    )
    lines = "".join(
        "<tr>"
        + "".join(
            f"<td{' class=left' if i == 0 else ''}>{escape(text)}</td>"
            for i, text in enumerate(cells)
        )
        + "</tr>"
        for cells in body
    )
    return (
        f'<div class="card scroll"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{lines}</tbody></table></div>"
    )


def fold_table(summary: str, table: str, body: list[list[str]] | list[str]) -> str:
    is_open = " open" if len(body) <= _OPEN_ROWS else ""
    return f"<details{is_open}><summary>{escape(summary)}</summary>{table}</details>"


def format_number(value: float | None, decimals: int, scale: float = 1.0) -> str:
    return "–" if value is None else f"{value * scale:.{decimals}f}"
