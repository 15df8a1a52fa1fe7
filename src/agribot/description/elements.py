"""Reading numbers and shapes out of XML elements, with errors that name the place."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from agribot.core.errors import DescriptionError, describe_range
from agribot.core.messages import Vec3
from agribot.description.markup import find_place

LARGEST = 1e12  # stiffnesses of other simulators reach 1e9
MOST_FRICTION = 100.0  # largest friction, more than any surface has


class FileFinding(NamedTuple):
    """A problem in a file; line 0 where it has no place of its own.

    `summary` is the text for a user who only loads the file; "" shows nothing. With a fault the
    file cannot be used; all else is a note, such as of a number that is assumed.
    """

    file: str
    line: int
    text: str
    summary: str
    is_fault: bool = False

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.text}" if self.line else f"{self.file}: {self.text}"


class PlacedError(DescriptionError):
    """An error with its place in a file."""

    def __init__(self, finding: FileFinding) -> None:
        super().__init__(str(finding))
        self.finding = finding


class SourceFile:
    """The file that elements come from, and the problems found in it.

    With `collecting`, `attempt` notes errors and goes on; otherwise it raises them.
    """

    def __init__(self, file: str, *, collecting: bool = False) -> None:
        self.file = file
        self.collecting = collecting
        self.findings: list[FileFinding] = []
        self._places: list[tuple[str, int]] = []

    def fail(self, where: str, what: str) -> DescriptionError:
        return PlacedError(self._make_finding(f"{where}: {what}")._replace(is_fault=True))

    def check_within(self, where: str, value: float, least: float, most: float) -> None:
        """Refuse a number outside of its range, both ends included.

        Raises: DescriptionError: it is outside.
        """
        if not least <= value <= most:
            raise self.fail(f"{where} {value:g}", describe_range(least, most))

    def warn(self, text: str, element: ET.Element | None = None, *, quiet: bool = False) -> None:
        """Note a harmless problem; a `quiet` one only shows in a check of the file."""
        self.findings.append(self._make_finding(text, element, quiet=quiet))

    @contextmanager
    def attempt(self, element: ET.Element) -> Iterator[None]:
        """Name the place of `element` in the errors raised inside."""
        self._places.append(find_place(element))
        try:
            yield
        except DescriptionError as error:
            if not self.collecting:
                raise
            self.note(error)
        finally:
            self._places.pop()

    def note(self, error: DescriptionError) -> None:
        """Keep an error as a finding."""
        finding = getattr(error, "finding", None)
        if finding is None:
            finding = self._make_finding(str(error).removeprefix(f"{self.file}: "))
        self.findings.append(finding._replace(is_fault=True))

    def list_warnings(self) -> tuple[str, ...]:
        """Return the texts for the user of the file, each once."""
        counted = Counter(finding.summary for finding in self.findings if finding.summary)
        return tuple(
            text if times == 1 else f"{text} ({times} times)" for text, times in counted.items()
        )

    def _make_finding(
        self, text: str, element: ET.Element | None = None, *, quiet: bool = False
    ) -> FileFinding:
        file, line = self._places[-1] if self._places else ("", 0)
        if element is not None and find_place(element)[1]:
            file, line = find_place(element)
        return FileFinding(file or self.file, line, text, "" if quiet else text)

    def parse_numbers(self, text: str | None, count: int, where: str) -> tuple[float, ...]:
        """Parse exactly `count` numbers separated by blanks.

        Raises: DescriptionError: a different count, not numbers, or not finite.
        """
        words = (text or "").split()
        try:
            values = tuple(float(word) for word in words)
        except ValueError as error:
            raise self.fail(where, f"'{text}' is not a list of numbers; write {count}") from error
        if not all(math.isfinite(value) for value in values):
            raise self.fail(where, f"'{text}' is not finite; write finite numbers")
        if any(abs(value) > LARGEST for value in values):
            raise self.fail(where, f"'{text}' is beyond {LARGEST:g}; write smaller numbers")
        if len(values) != count:
            raise self.fail(
                where,
                f"needs {count} numbers, found {len(values)} in '{text or ''}'; write {count}",
            )
        return values

    def parse_number(self, text: str | None, where: str) -> float:
        return self.parse_numbers(text, 1, where)[0]

    def parse_friction(self, text: str | None, where: str) -> float:
        """Parse a coefficient of friction, which may be infinite: the other surface's then counts.

        Raises: DescriptionError: not a number.
        """
        is_infinite = (text or "").strip().lower().lstrip("+") in ("inf", "infinity")
        return MOST_FRICTION if is_infinite else self.parse_number(text, where)

    def parse_vec3(self, text: str | None, where: str) -> Vec3:
        x, y, z = self.parse_numbers(text, 3, where)
        return x, y, z

    def require_child(self, element: ET.Element, tag: str, where: str) -> ET.Element:
        child = element.find(tag)
        if child is None:
            has = ", ".join(f"<{inner.tag}>" for inner in element) or "nothing"
            raise self.fail(where, f"<{tag}> is missing; it has {has}")
        return child

    def require_attribute(self, element: ET.Element, name: str, where: str) -> str:
        value = element.get(name)
        if value is None:
            raise self.fail(where, f"<{element.tag}> has no attribute '{name}'; add it")
        return value
