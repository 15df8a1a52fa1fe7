"""YAML that somebody else wrote, read within bounds: no anchors and aliases, no depth, no bulk.

An alias stands for all that it names, so that a few lines with aliases of aliases are more than
any memory holds, and one inside its own anchor has no end.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from agribot.core.table_text import decode_text

MAX_BYTES = 64_000
MAX_DEPTH = 20
MAX_NODES = 16_000  # values, keys and brackets


class UnusableYaml(Exception):
    """The text says why, and where in the file."""


def read_yaml(data: bytes) -> Any:
    """Read the one document in `data`.

    Raises: UnusableYaml: it is no YAML, has anchors, or is larger than a file written by hand.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.composer import Composer
    from ruamel.yaml.error import YAMLError
    from ruamel.yaml.events import AliasEvent

    class BoundedComposer(Composer):
        nodes = 0

        def compose_node(self, parent: Any, index: Any) -> Any:
            event = self.parser.peek_event()
            line = event.start_mark.line + 1
            if isinstance(event, AliasEvent) or event.anchor:
                raise UnusableYaml(f"line {line}: anchors and aliases (& and *) are not read")
            self.nodes += 1
            if self.nodes > MAX_NODES:
                raise UnusableYaml(f"line {line}: more than {MAX_NODES} values")
            if self.depth >= MAX_DEPTH:
                raise UnusableYaml(f"line {line}: nested more than {MAX_DEPTH} deep")
            return super().compose_node(parent, index)

    if len(data) > MAX_BYTES:
        raise UnusableYaml(f"larger than {MAX_BYTES // 1000} kB")
    reader = YAML(typ="safe", pure=True)
    reader.Composer = BoundedComposer
    try:
        return reader.load(decode_text(data))
    except (
        YAMLError,
        ValueError,
        ArithmeticError,
        LookupError,
        TypeError,
        RecursionError,
    ) as error:
        raise UnusableYaml(str(error).partition("\n")[0]) from error


def read_yaml_file(path: Path) -> Any:
    """Read the one document in a file.

    Raises: OSError: it cannot be read. UnusableYaml: as `read_yaml`.
    """
    with path.open("rb") as file:
        return read_yaml(file.read(MAX_BYTES + 1))
