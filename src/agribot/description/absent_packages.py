"""Parts of a xacro description that lie in packages this machine does not have.

They are left out, each with a warning: a robot drives without the mount of its laser scanner.
"""

from __future__ import annotations

import glob
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import xacro
import xacro.substitution_args as substitution

from agribot.description.elements import SourceFile
from agribot.description.package import PACKAGE, find_named_package_folder, find_package_folder

FIND = re.compile(r"\$\(find\s+([^)\s]+)\s*\)")


class AbsentPackages:
    """Finds packages for xacro without a ROS index, and leaves out those that are absent."""

    def __init__(self, top: Path, source: SourceFile) -> None:
        self._top = top
        self._source = source
        self._left_out = False

    @contextmanager
    def leave_out(self) -> Iterator[None]:
        """Make xacro look for packages next to the file and leave absent ones out, while open."""
        ask_ros = substitution._eval_find
        include, call = xacro.process_include, xacro.handle_macro_call

        def find(package: str) -> str:
            folder = find_package_folder(package, self._top) or _find_ros_package(ask_ros, package)
            if folder is None:
                self._warn(f"package '{package}' is not on this machine; the robot goes without it")
                return f"package://{package}"
            return str(folder)

        def include_known(node: Any, macros: Any, symbols: Any, func: Any) -> None:
            package = self._find_missing(node.getAttribute("filename"), symbols, ask_ros)
            if package is None:
                include(node, macros, symbols, func)
                return
            file = FIND.sub("", node.getAttribute("filename")).lstrip("/")
            self._warn(f"package '{package}' is not on this machine; its {file} is left out")
            xacro.replace_node(node, by=None)

        def call_known(node: Any, macros: Any, symbols: Any) -> bool:
            if self._left_out and _is_unknown_macro(node, macros, symbols):
                self._warn(f"<{node.tagName}> is defined in no file that is here; it is left out")
                xacro.replace_node(node, by=None)
                return True
            return bool(call(node, macros, symbols))

        substitution._eval_find = substitution._eval_dict["find"] = find
        xacro.process_include, xacro.handle_macro_call = include_known, call_known
        try:
            yield
        finally:
            substitution._eval_find = substitution._eval_dict["find"] = ask_ros
            xacro.process_include, xacro.handle_macro_call = include, call

    def cut_loose_ends(self, root: ET.Element) -> None:
        """Remove the joints and links that hang on links that were left out."""
        if not self._left_out:
            return
        while loose := self._find_loose_joints(root):
            for joint in loose:
                self._warn(f"joint '{joint.get('name')}' ends on a link that is left out", joint)
                root.remove(joint)
                self._remove_links(root, _find_end(joint, "child"))
        links = {link.get("name") for link in root.findall("link")}
        for block in root.findall("gazebo"):
            if block.get("reference") not in {None, *links}:
                root.remove(block)

    def _find_missing(self, spec: str, symbols: Any, ask_ros: Any) -> str | None:
        """Return the absent package that an include needs, or None."""
        found = FIND.search(spec)
        if found is None:
            return None
        package = found.group(1)
        if package == PACKAGE or find_named_package_folder(package, self._top) is not None:
            return None
        if _find_ros_package(ask_ros, package) is not None:
            return None
        if find_package_folder(package, self._top) is None:
            return package
        file = str(xacro.eval_text(spec, symbols))
        return None if Path(file).is_file() or glob.glob(file) else package

    def _find_loose_joints(self, root: ET.Element) -> list[ET.Element]:
        links = {link.get("name") for link in root.findall("link")}
        return [
            joint
            for joint in root.findall("joint")
            if not {_find_end(joint, "parent"), _find_end(joint, "child")} <= links
        ]

    def _remove_links(self, root: ET.Element, name: str | None) -> None:
        """Remove a link that no joint holds any more; its own joints are loose then."""
        for link in root.findall("link"):
            if link.get("name") == name:
                root.remove(link)

    def _warn(self, text: str, element: ET.Element | None = None) -> None:
        self._left_out = True
        self._source.warn(text, element)


def _find_ros_package(ask_ros: Any, package: str) -> Path | None:
    """Return the package's folder in a ROS installation, or None."""
    try:
        return Path(ask_ros(package))
    except (ImportError, LookupError, ValueError, OSError):
        return None


def _is_unknown_macro(node: Any, macros: Any, symbols: Any) -> bool:
    if not node.tagName.startswith("xacro:") or node.tagName == "xacro:call":
        return False
    try:
        xacro.resolve_macro(node.tagName.removeprefix("xacro:"), macros, symbols)
    except KeyError:
        return True
    return False


def _find_end(joint: ET.Element, which: str) -> str | None:
    element = joint.find(which)
    return None if element is None else element.get("link")
