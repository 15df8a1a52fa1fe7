"""From xacro to URDF text, with the real xacro library but without a ROS installation."""

from __future__ import annotations

import threading
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from xml.parsers.expat import ExpatError

import xacro
import xacro.substitution_args as substitution

from agribot.description.elements import Source
from agribot.description.markup import parse_xml, read_xml
from agribot.description.package import package_folder
from agribot.description.xacro_dialect import OldDialect
from agribot.errors import DescriptionError

# xacro keeps the files it works on in module variables.
_XACRO_LOCK = threading.Lock()


class _Arguments(dict[str, str]):
    """Arguments of a xacro file that remember which names the file declares."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.declared: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.declared.add(str(name))
        return super().__contains__(name)


def expand(path: Path, mappings: Mapping[str, str], source: Source) -> ET.Element:
    """The URDF tree of a xacro or URDF file.

    Raises: DescriptionError: the file or one that it includes is missing or broken, or
        `mappings` names an argument that no file declares.
    """
    if not path.is_file():
        raise DescriptionError(f"robot file {path} does not exist; check the path")
    if path.suffix != ".xacro" and mappings:
        raise DescriptionError(
            f"{path} is not a xacro file, so it takes no arguments such as "
            f"'{next(iter(mappings))}'; leave them out or name the .xacro file"
        )
    if path.suffix == ".xacro":
        dialect = OldDialect(source)
        root = parse_xml(_expanded(path, mappings, dialect), path.name)
        dialect.place(root)
    else:
        root = read_xml(path)
    if root.tag != "robot":
        raise DescriptionError(
            f"{path}: the top element is <{root.tag}>, a robot description has <robot>"
        )
    return root


def _expanded(path: Path, mappings: Mapping[str, str], dialect: OldDialect) -> str:
    arguments = _Arguments(mappings)
    with _XACRO_LOCK, _package_search(path), dialect.understood():
        xacro.init_stacks(str(path))
        try:
            document = xacro.parse(None, str(path))
            xacro.process_doc(document, mappings=arguments)
        except ExpatError as error:
            raise DescriptionError(
                f"{_current_file(path)}: not well-formed XML: {error}; mend that line"
            ) from error
        except (
            xacro.XacroException, substitution.SubstitutionException,
            NameError, SyntaxError, TypeError, ValueError, KeyError, ZeroDivisionError,
        ) as error:  # fmt: skip
            raise DescriptionError(
                f"{_current_file(path)}: xacro cannot expand it: {str(error).strip()}"
            ) from error
    unknown = sorted(set(mappings) - arguments.declared)
    if unknown:
        raise DescriptionError(
            f"{path.name} has no argument '{unknown[0]}'; it has: "
            f"{', '.join(sorted(arguments.declared))}"
        )
    return str(document.toxml())


def _current_file(top: Path) -> str:
    """The file that xacro was working on when it gave up."""
    stack = [name for name in (xacro.filestack or []) if name]
    return stack[-1] if stack else str(top)


@contextmanager
def _package_search(top: Path) -> Iterator[None]:
    """Let `$(find PACKAGE)` look next to the file instead of in a ROS index."""
    ask_ros = substitution._eval_find

    def find(package: str) -> str:
        folder = package_folder(package, top)
        if folder is not None:
            return str(folder)
        try:
            return str(ask_ros(package))
        except ImportError as error:
            raise substitution.SubstitutionException(
                f"package '{package}' not found above {top}, and no ROS installation to ask"
            ) from error

    substitution._eval_find = substitution._eval_dict["find"] = find
    try:
        yield
    finally:
        substitution._eval_find = substitution._eval_dict["find"] = ask_ros
