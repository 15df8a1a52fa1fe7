"""Expansion of xacro to URDF text, with the real xacro library but without a ROS installation."""

from __future__ import annotations

import re
import threading
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from xml.parsers.expat import ExpatError

import xacro

from agribot.core.errors import CHECK_PATH, DescriptionError, explain_os_error
from agribot.description.absent_packages import AbsentPackages
from agribot.description.elements import FileFinding, SourceFile
from agribot.description.markup import copy_tree, parse_xml, read_xml
from agribot.description.package import list_robot_files, read_search_paths
from agribot.description.xacro_arithmetic import bound_arithmetic
from agribot.description.xacro_dialect import OldDialect, read_utf_8
from agribot.description.xacro_yaml import bound_yaml

# Lock of xacro, which keeps the files it works on in module variables.
_XACRO_LOCK = threading.Lock()
# Comments and declarations, and the first element.
_SDF = re.compile(rb"(?:\s*<(?:!--(?:[^-]|-(?!->))*-->|[?!](?!--)[^>]*>))*\s*<sdf[\s>]")


class _Arguments(dict[str, str]):
    """Arguments of a xacro file that remember which names the file declares."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.declared: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.declared.add(str(name))
        return super().__contains__(name)


def expand(path: Path, mappings: Mapping[str, str], source: SourceFile) -> ET.Element:
    """Expand a xacro or URDF file to its URDF tree, without the packages that are absent.

    Raises: DescriptionError: the file or one of its own package is missing or broken, or
        `mappings` names an argument that no file declares.
    """
    if not path.is_file():
        raise DescriptionError(f"robot file {path} does not exist; check the path")
    is_template = is_xacro(path)
    if mappings and not is_template:
        raise DescriptionError(
            f"{path} is not a xacro file, so it takes no arguments such as "
            f"'{next(iter(mappings))}'; leave them out or name the .xacro file"
        )
    if path in list_robot_files().values():
        once, findings = _expand_once(path, tuple(mappings.items()), read_search_paths())
        source.findings += findings
        root = copy_tree(once)
    elif is_template:
        root = _expand_xacro(path, mappings, source)
    else:
        root = read_xml(path)
    if root.tag != "robot":
        raise DescriptionError(
            f"{path}: the top element is <{root.tag}>, a robot description has <robot>; name "
            "another file"
        )
    return root


def is_xacro(path: Path) -> bool:
    """Return whether to expand a file: by its suffix, or because it declares xacro's namespace.

    Raises: DescriptionError: it cannot be read.
    """
    with explain_os_error(f"{path} cannot be read", CHECK_PATH, DescriptionError):
        return path.suffix == ".xacro" or b"xmlns:xacro" in read_utf_8(path)


def is_sdf(path: Path) -> bool:
    """Return whether a file is an SDF, by its suffix or its first element.

    Raises: DescriptionError: it cannot be read.
    """
    with explain_os_error(f"{path} cannot be read", CHECK_PATH, DescriptionError):
        return path.suffix.lower() == ".sdf" or bool(_SDF.match(read_utf_8(path)))


@cache
def _expand_once(
    path: Path, mappings: tuple[tuple[str, str], ...], _paths: tuple[str, ...]
) -> tuple[ET.Element, tuple[FileFinding, ...]]:
    """Expand a packaged robot once; a run reads it as a robot and as text, and never writes it."""
    source = SourceFile(path.name)
    return _expand_xacro(path, dict(mappings), source), tuple(source.findings)


def _expand_xacro(path: Path, mappings: Mapping[str, str], source: SourceFile) -> ET.Element:
    dialect, absent = OldDialect(source), AbsentPackages(path, source)
    root = parse_xml(_run_xacro(path, mappings, dialect, absent), path.name)
    dialect.place(root)
    absent.cut_loose_ends(root)
    return root


def _run_xacro(
    path: Path, mappings: Mapping[str, str], dialect: OldDialect, absent: AbsentPackages
) -> str:
    arguments = _Arguments(mappings)
    with _XACRO_LOCK, absent.leave_out(), dialect.accept(), bound_arithmetic(), bound_yaml():
        xacro.init_stacks(str(path))
        try:
            document = xacro.parse(None, str(path))
            xacro.process_doc(document, mappings=arguments)
        except ExpatError as error:
            raise DescriptionError(
                f"{_find_current_file(path)}: not well-formed XML: {error}; fix that line"
            ) from error
        except RecursionError as error:
            file = _find_current_file(path)
            raise DescriptionError(
                f"{file}: xacro cannot expand it: a file or macro includes itself; remove that"
            ) from error
        except Exception as error:  # xacro raises any kind of error on a broken file
            reason = " ".join(str(error).split()) or type(error).__name__
            raise DescriptionError(
                f"{_find_current_file(path)}: xacro cannot expand it: {reason}; correct it there"
            ) from error
    unknown = sorted(set(mappings) - arguments.declared)
    if unknown:
        raise DescriptionError(
            f"{path.name} has no argument '{unknown[0]}'; it has: "
            f"{', '.join(sorted(arguments.declared))}"
        )
    return str(document.toxml())


def _find_current_file(top: Path) -> str:
    """Return the file that xacro was working on when it failed."""
    stack = [name for name in (xacro.filestack or []) if name]
    return stack[-1] if stack else str(top)
