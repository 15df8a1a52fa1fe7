"""Pages from templates of Jinja2: files NAME.html.j2 beside the code that fills them."""

from __future__ import annotations

from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined

from agribot.record.drawing import encode_svg
from agribot.record.tiles import format_number


def fill_template(template: str, **values: object) -> str:
    """Fill a template, named by its path below the package; all values are escaped."""
    return _environment().get_template(template).render(values)


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("agribot", ""), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {"number": format_number, "svg": encode_svg}
    return environment
