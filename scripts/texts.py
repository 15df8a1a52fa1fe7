"""What people read in this repository, place by place: text, comments, constants, names."""

from __future__ import annotations

import ast
import io
import os
import pickle
import re
import tokenize
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

CODE = ("src", "scripts", "tests", "benchmarks", "examples", "firmware")
# Files of other languages: their strings and comments.
OTHERS = ("src/**/*.toml", "src/**/*.xacro", "firmware/**/*.[ch]", "deploy/*")
WEB = ("web/src/**/*.ts", "web/src/**/*.css", "web/test/**/*.ts", "web/*.html", "src/**/*.html.j2")
PAGES = ("docs/**/*.md", "README.md", "CONTRIBUTING.md", "SECURITY.md")
# Comments, docstrings and names are read in the package alone, text everywhere.
PACKAGE = "src/"
KEPT = "build/places.pickle"  # places of the last run: reading all files takes 8 CPU seconds
Kind = Literal["text", "comments", "constants", "docstrings", "names"]

_CODE_SPAN = re.compile(r"`[^`]*`")
_INSERTED = re.compile(r"\{[^{}]*\}")
_KEY = re.compile(r"""[a-z]*(['"])[a-z0-9_]*\1""")
_OTHER_TEXT = re.compile(r"""'[^']*'|"[^"]*"|//.*|/\*.*|^ \*.*|#.*|<!--.*|^\s+[^<>={]*$""")
# Comments and strings of TypeScript and CSS; of HTML and templates, which have little else, all.
_WEB_TEXT = re.compile(
    r"""//[^\n]*|/\*.*?\*/|'(?:[^'\\\n]|\\.)*'|"(?:[^"\\\n]|\\.)*"|`(?:[^`\\]|\\.)*`""",
    re.DOTALL,
)
_ALL_TEXT = re.compile(r".+", re.DOTALL)
_CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*")


class Place(NamedTuple):
    file: str
    line: int
    text: str
    kind: Kind = "text"


# Reads the places of a file by its name and its text.
_Reader = Callable[[str, str], Iterator[Place]]
_Kept = tuple[int, list[Place]]  # checksum of the file's text, and its places


class _File(NamedTuple):
    name: str
    tokens: list[tokenize.TokenInfo]


def iterate_places(root: Path) -> Iterator[Place]:
    """Yield all that is read: each line of code's text and of pages, each comment, each name."""
    kept = _load_kept(root)
    found: dict[str, _Kept] = {}
    for path, read in _list_files(root):
        name, source = path.relative_to(root).as_posix(), path.read_text(encoding="utf-8")
        digest = zlib.crc32(source.encode())
        one = kept.get(name)
        found[name] = one if one and one[0] == digest else (digest, list(read(name, source)))
        yield from found[name][1]
    if found != kept:
        _keep(root, found)


def _list_files(root: Path) -> Iterator[tuple[Path, _Reader]]:
    for folder in CODE:
        yield from ((path, _read_code) for path in sorted((root / folder).rglob("*.py")))
    kinds: tuple[tuple[tuple[str, ...], _Reader], ...] = (
        (OTHERS, _read_other), (WEB, _read_web), (PAGES, _read_page)
    )  # fmt: skip
    for patterns, read in kinds:
        for pattern in patterns:
            yield from ((path, read) for path in sorted(root.glob(pattern)))


def _load_kept(root: Path) -> dict[str, _Kept]:
    """Load the places that an earlier run of this very script found in each file."""
    try:
        script, kept = pickle.loads((root / KEPT).read_bytes())
    except (OSError, EOFError, ValueError, pickle.UnpicklingError):
        return {}
    return kept if script == _digest_script() else {}


def _keep(root: Path, found: dict[str, _Kept]) -> None:
    (root / KEPT).parent.mkdir(exist_ok=True)
    half = (root / KEPT).with_suffix(f".{os.getpid()}")
    half.write_bytes(pickle.dumps((_digest_script(), found)))
    half.replace(root / KEPT)


def _digest_script() -> int:
    return zlib.crc32(Path(__file__).read_bytes())


def _read_code(name: str, source: str) -> Iterator[Place]:
    file = _File(name, list(tokenize.generate_tokens(io.StringIO(source).readline)))
    yield from _find_texts(file)
    if name.startswith(PACKAGE):
        nodes = list(ast.walk(ast.parse(source)))
        yield from _find_comments(file, nodes[0])
        yield from _find_docstrings(name, nodes)
        yield from _find_names(name, nodes)


def _read_other(name: str, source: str) -> Iterator[Place]:
    for at, line in enumerate(source.splitlines(), 1):
        yield from (Place(name, at, text) for text in _OTHER_TEXT.findall(line))


def _read_web(name: str, source: str) -> Iterator[Place]:
    for found in (_ALL_TEXT if name.endswith((".html", ".j2")) else _WEB_TEXT).finditer(source):
        first = source.count("\n", 0, found.start()) + 1
        for at, line in enumerate(found.group().splitlines(), first):
            yield Place(name, at, line)


def _read_page(name: str, source: str) -> Iterator[Place]:
    is_code = False
    for at, line in enumerate(source.splitlines(), 1):
        is_code ^= line.lstrip().startswith("```")
        if not is_code:
            yield Place(name, at, _CODE_SPAN.sub("``", line))


def _find_texts(file: _File) -> Iterator[Place]:
    for token in file.tokens:
        if _is_text(token):
            lines = _strip_code(token).splitlines()
            yield from (Place(file.name, at, line) for at, line in enumerate(lines, token.start[0]))


def _is_text(token: tokenize.TokenInfo) -> bool:
    is_string = token.type == tokenize.STRING and _KEY.fullmatch(token.string) is None
    kind = tokenize.tok_name[token.type]
    return is_string or kind in {"COMMENT", "FSTRING_MIDDLE"}


def _strip_code(token: tokenize.TokenInfo) -> str:
    """Take the code out of a text: what it quotes, and what an f-string inserts."""
    is_formatted = "f" in token.string[:3].partition('"')[0]
    text = _INSERTED.sub("{}", token.string) if is_formatted else token.string
    return _CODE_SPAN.sub("``", text)


def _find_comments(file: _File, module: ast.AST) -> Iterator[Place]:
    alone, beside = _join_comments(file)
    yield from (*alone.values(), *beside.values())
    for node in module.body if isinstance(module, ast.Module) else ():
        if _is_constant(node):
            found = (alone.get(node.lineno - 1), beside.get(node.lineno))
            yield from (place._replace(kind="constants") for place in found if place is not None)


def _join_comments(file: _File) -> tuple[dict[int, Place], dict[int, Place]]:
    """Give the comments on lines of their own by their last line, and those beside code."""
    alone: dict[int, Place] = {}
    beside: dict[int, Place] = {}
    for token in (token for token in file.tokens if token.type == tokenize.COMMENT):
        at = token.start[0]
        place = Place(file.name, at, _CODE_SPAN.sub("``", token.string.lstrip("#: ")), "comments")
        if token.line[: token.start[1]].strip():
            beside[at] = place
        else:
            above = alone.pop(at - 1, None)
            alone[at] = above._replace(text=f"{above.text} {place.text}") if above else place
    return alone, beside


def _is_constant(node: ast.stmt) -> bool:
    target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
    return isinstance(target, ast.Name) and _CONSTANT.fullmatch(target.id) is not None


def _find_docstrings(name: str, nodes: Sequence[ast.AST]) -> Iterator[Place]:
    """Find the first line of each docstring."""
    for node in nodes:
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            if text:
                yield Place(name, node.body[0].lineno, text.splitlines()[0], "docstrings")


def _find_names(file: str, nodes: Sequence[ast.AST]) -> Iterator[Place]:
    """Find what is defined: the module, classes, functions, parameters, variables, attributes."""
    lines = {Path(file).stem: 1}
    for node in nodes:
        name = _read_name(node)
        if name is not None:
            lines.setdefault(name, getattr(node, "lineno", 1))
    yield from (Place(file, at, name, "names") for name, at in lines.items())


def _read_name(node: ast.AST) -> str | None:
    match node:
        case ast.ClassDef(name=name) | ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
            return name
        case ast.arg(arg=name):
            return name
        case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
            return name
    return None
