"""Reading numbers and shapes out of XML elements, with errors that name the place."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

from agribot.errors import DescriptionError
from agribot.messages import Vec3


class Source:
    """The file that an element came from, for error messages."""

    def __init__(self, file: str) -> None:
        self.file = file

    def fail(self, where: str, what: str) -> DescriptionError:
        return DescriptionError(f"{self.file}: {where}: {what}")

    def numbers(self, text: str | None, count: int, where: str) -> tuple[float, ...]:
        """Exactly `count` numbers separated by blanks.

        Raises: DescriptionError: a different count, not numbers, or not finite.
        """
        words = (text or "").split()
        try:
            values = tuple(float(word) for word in words)
        except ValueError as error:
            raise self.fail(where, f"'{text}' is not a list of numbers") from error
        if not all(math.isfinite(value) for value in values):
            raise self.fail(where, f"'{text}' is not finite")
        if len(values) != count:
            raise self.fail(where, f"needs {count} numbers, found {len(values)} in '{text or ''}'")
        return values

    def number(self, text: str | None, where: str) -> float:
        return self.numbers(text, 1, where)[0]

    def vec3(self, text: str | None, where: str) -> Vec3:
        x, y, z = self.numbers(text, 3, where)
        return x, y, z

    def child(self, element: ET.Element, tag: str, where: str) -> ET.Element:
        child = element.find(tag)
        if child is None:
            has = ", ".join(f"<{inner.tag}>" for inner in element) or "nothing"
            raise self.fail(where, f"<{tag}> is missing; it has {has}")
        return child

    def attribute(self, element: ET.Element, name: str, where: str) -> str:
        value = element.get(name)
        if value is None:
            raise self.fail(where, f"<{element.tag}> has no attribute '{name}'")
        return value
