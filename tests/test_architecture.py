"""The rules of the house, read off the source: layers, imports, sizes, words."""

from __future__ import annotations

import ast
import gc
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "agribot"

HOUSE = tomllib.loads((ROOT / "docs" / "architecture.toml").read_text(encoding="utf-8"))
ROOMS = {room["name"]: room for room in HOUSE["rooms"]}
MOST_NAMES, MOST_FLOORS = 16, 9  # at the top of the package; of the house
MOST_FILES = 27  # of one folder in a room with wings

LIGHT = {"numpy", "msgspec", "tomli_w"}
# What pure decisions have no business with: clocks, threads, the outside world, hidden randomness.
IMPURE = {
    "asyncio", "concurrent", "datetime", "multiprocessing", "random", "signal", "socket",
    "subprocess", "threading", "time", "urllib",
}  # fmt: skip

# A participle names a value, not what a function does; "feed" and "speed" are no participles.
PARTICIPLE = re.compile(
    r"_?(?:[a-z]*[^e]ed|shown|told|taken|begun|seen|given|made|found|held|sent|said|heard|kept|drawn)"
)
MAX_FUNCTION_LINES = 50
BANNED_NAMES = {"utils", "util", "helpers", "helper", "common", "manager", "misc"}
MAY_PRINT = {"cli"}
# Paths of somebody's machine, and words about how the project came to be.
PRIVATE = re.compile(
    "|".join(["/" + "work/", "/" + "home/", "/" + "root/", "proto" + "type", "seed" + "-systems"])
)
# Errors whose texts a person reads, with all that are derived from them.
REPORTED = {"AgribotError", "Unusable", "Refused", "BadLayer", "_Fault"}
# What could not be used of labels: the import adds its advice to each.
ADVISED_ELSEWHERE = {"LabelFileError"}
TEXT_SUFFIXES = {
    ".py", ".toml", ".md", ".txt", ".yaml", ".yml", ".json", ".xacro", ".urdf", ".cfg", ".j2",
}  # fmt: skip

FunctionNode = ast.FunctionDef | ast.AsyncFunctionDef


def sources() -> list[Path]:
    return sorted(SOURCE.rglob("*.py"))


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module", autouse=True)
def _parsed() -> Iterator[None]:
    """Parse without searches for garbage, which would go through all nodes again and again."""
    gc.disable()
    for path in sources():
        nodes_of(path)
    gc.enable()
    yield
    tree_of.cache_clear()
    nodes_of.cache_clear()


def room_of(module: str) -> str:
    """The room of a module inside agribot, such as "autonomy/plan"; empty for the face itself."""
    parts = module.split(".")[1:]
    names = ("/".join(parts[:length]) for length in range(len(parts), 0, -1))
    return next((name for name in names if name in ROOMS), "")


def floor_of(room: str) -> int:
    return int(ROOMS[room]["floor"])


def module_of(path: Path) -> str:
    name = ".".join(path.relative_to(SOURCE.parent).with_suffix("").parts)
    return name.removesuffix(".__init__")


def show(path: Path) -> str:
    return str(path.relative_to(SOURCE))


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(tree_of(path)))


def imports(path: Path) -> Iterator[str]:
    """Full names of all imported modules, also of imports within functions."""
    for inner in nodes_of(path):
        if isinstance(inner, ast.Import):
            yield from (alias.name for alias in inner.names)
        elif isinstance(inner, ast.ImportFrom) and inner.module:
            yield inner.module
            yield from (f"{inner.module}.{alias.name}" for alias in inner.names)


@cache
def rooms_used(path: Path) -> set[str]:
    """Other rooms of the house that a file imports."""
    names = (name for name in imports(path) if name.startswith("agribot."))
    return {room_of(name) for name in names} - {"", room_of(module_of(path))}


def outside(path: Path) -> set[str]:
    """Top-level packages that a file imports and that are not agribot."""
    return {name.split(".")[0] for name in imports(path)} - {"agribot", "__future__"}


def functions(path: Path) -> Iterator[tuple[str, FunctionNode]]:
    for node in nodes_of(path):
        if isinstance(node, FunctionNode):
            yield f"{show(path)}: {node.name}", node


def test_every_file_has_a_room() -> None:
    homeless = [show(path) for path in sources() if not room_of(module_of(path))]
    assert homeless == ["__init__.py", "__main__.py"], "give them a room in docs/architecture.toml"
    empty = [name for name in ROOMS if not (SOURCE / name).is_dir()]
    assert not empty


def test_the_house_is_small_enough_to_be_seen() -> None:
    names = {path.name for path in SOURCE.iterdir()} - {"__pycache__"}
    assert len(names) <= MOST_NAMES
    assert len({room["floor"] for room in HOUSE["rooms"]}) <= MOST_FLOORS


def test_imports_go_to_a_lower_floor() -> None:
    wrong = [
        f"{show(path)} (floor {floor_of(room)}) imports {used} (floor {floor_of(used)})"
        for path in sources()
        if (room := room_of(module_of(path)))
        for used in sorted(rooms_used(path))
        if floor_of(used) >= floor_of(room)
    ]
    assert not wrong, "\n".join(wrong)


def wing_of(module: str) -> tuple[str, int]:
    """Room of a module and the place of its wing in the room's list; -1 outside of wings."""
    room = room_of(module)
    below = module.removeprefix("agribot." + room.replace("/", ".")).split(".")[1:]
    wings = ROOMS.get(room, {}).get("wings", [])
    return room, wings.index(below[0]) if below and below[0] in wings else -1


def test_a_wing_imports_only_wings_before_it() -> None:
    wrong = [
        f"{show(path)} imports {used}"
        for path in sources()
        for room, wing in [wing_of(module_of(path))]
        for used in sorted(set(imports(path)))
        if wing >= 0 and wing_of(used)[0] == room and wing_of(used)[1] > wing
    ]
    assert not wrong, "\n".join(wrong)


def test_rooms_with_wings_have_few_files_in_each_folder() -> None:
    folders = [
        folder
        for name, room in ROOMS.items()
        if "wings" in room
        for folder in (SOURCE / name, *(SOURCE / name / wing for wing in room["wings"]))
    ]
    crowded = {show(folder): len(list(folder.glob("*.py"))) for folder in folders}
    assert {name: count for name, count in crowded.items() if count > MOST_FILES} == {}


def test_no_module_imports_itself_through_others() -> None:
    names = {module_of(path) for path in sources()}
    graph = {
        module_of(path): {
            name for name in imports(path) if name in names and name != module_of(path)
        }
        for path in sources()
    }
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, " -> ".join((*trail[trail.index(name) :], name))
        if name not in done:
            for inner in sorted(graph[name]):
                visit(inner, (*trail, name))
            done.add(name)

    for name in sorted(graph):
        visit(name, ())


def test_imports_are_absolute() -> None:
    wrong = [
        f"{show(path)}:{node.lineno}"
        for path in sources()
        for node in nodes_of(path)
        if isinstance(node, ast.ImportFrom) and node.level > 0
    ]
    assert not wrong, "\n".join(wrong)


def test_heavy_packages_stay_in_the_folder_that_needs_them() -> None:
    wrong = [
        f"{show(path)} imports {package}; only {HOUSE['packages'].get(package, [])} may"
        for path in sources()
        for package in sorted(outside(path) - LIGHT - set(sys.stdlib_module_names))
        if room_of(module_of(path)) not in HOUSE["packages"].get(package, [])
    ]
    assert not wrong, "\n".join(wrong)


def test_every_package_that_is_imported_is_declared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"].values()
    lines = [*project["dependencies"], *(line for extra in extras for line in extra)]
    declared = {re.split(r"[<>=\[ ]", line)[0].lower().replace("-", "_") for line in lines}
    import_names = {
        "pillow": "PIL",
        "mujoco_core": "mujoco",
        "opencv_python_headless": "cv2",
        "eclipse_zenoh": "zenoh",
        "foxglove_sdk": "foxglove",
        "rerun_sdk": "rerun",
        "pyserial": "serial",
        "python_can": "can",
        "pyshp": "shapefile",
        "ruamel.yaml": "ruamel",
        "pyyaml": "yaml",
    }
    known = {import_names.get(name, name) for name in declared}
    known |= {"llvmlite"} if "numba" in known else set()  # comes with numba, always
    used = set().union(*(outside(path) for path in sources())) - set(sys.stdlib_module_names)
    assert used <= known, f"{sorted(used - known)} not in pyproject.toml"


def test_decisions_know_no_clock_no_thread_and_no_hidden_dice() -> None:
    wrong = [
        f"{show(path)} imports {name}"
        for path in sources()
        if ROOMS.get(room_of(module_of(path)), {}).get("is_pure")
        for name in sorted(outside(path) & IMPURE)
    ]
    assert not wrong, "\n".join(wrong)


def loaded_by(*modules: str) -> set[str]:
    """Third-party packages that importing these modules loads in a fresh interpreter."""
    code = (
        "import sys\nbefore = set(sys.modules)\n"
        + "".join(f"import {module}\n" for module in modules)
        + "print(*{name.partition('.')[0] for name in set(sys.modules) - before})"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    own = {"agribot", "typing_extensions"}  # the latter: by msgspec, where it is installed
    names = set(result.stdout.split()) - set(sys.stdlib_module_names) - own
    return {name for name in names if not name.startswith("_")}


def test_the_bare_package_loads_nothing() -> None:
    assert loaded_by("agribot") == set()


def test_the_vocabulary_and_the_decisions_about_motion_need_only_numpy_and_msgspec() -> None:
    light = {
        "core",
        *(f"autonomy/{part}" for part in ("estimate", "plan", "control", "weeds", "implements")),
    }
    modules = [module_of(path) for path in sources() if room_of(module_of(path)) in light]
    assert loaded_by(*modules) <= LIGHT


def test_no_package_loads_anything_heavy_by_its_name_alone() -> None:
    packages = [module_of(path) for path in SOURCE.glob("*/__init__.py")]
    assert loaded_by(*packages, "agribot.cli.main") <= LIGHT


def test_functions_are_short() -> None:
    long = [
        name
        for path in sources()
        for name, node in functions(path)
        if (node.end_lineno or node.lineno) - node.lineno + 1 > MAX_FUNCTION_LINES
    ]
    assert not long, f"over {MAX_FUNCTION_LINES} lines"


def test_a_public_class_has_its_name_to_itself() -> None:
    places: dict[str, list[str]] = {}
    for path in sources():
        for node in tree_of(path).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places.setdefault(node.name, []).append(show(path))
    twice = {name: found for name, found in places.items() if len(found) > 1}
    assert not twice


def test_functions_are_verbs_and_no_bare_participles() -> None:
    wrong = [
        name
        for path in sources()
        for name, node in functions(path)
        if not node.decorator_list and PARTICIPLE.fullmatch(node.name)
    ]
    assert not wrong, "\n".join(wrong)


def test_modules_are_named_after_what_they_hold() -> None:
    wrong = [
        show(path)
        for path in sources()
        if BANNED_NAMES & set(path.relative_to(SOURCE).with_suffix("").parts)
    ]
    assert not wrong


def derived(bases: set[str]) -> set[str]:
    """Names of classes with all that are derived from them."""
    nodes = [n for path in sources() for n in tree_of(path).body if isinstance(n, ast.ClassDef)]
    more = {n.name for n in nodes if bases & {ast.unparse(base) for base in n.bases}} - bases
    return derived(bases | more) if more else bases


def write_text(node: ast.expr) -> str:
    """The text of a literal with {} for its values; {} alone for what is no literal."""
    parts = node.values if isinstance(node, ast.JoinedStr) else [node]
    return "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in parts)


def says_what_to_do(call: ast.Call, name: str) -> bool:
    """Whether its text has a part behind a semicolon, or ends with another text."""
    at = 1 if name in {"fail", "Unusable"} else 0
    text = write_text(call.args[at]) if len(call.args) > at else "{}"
    return ";" in text or text == "{}" or text.endswith(": {}")


def test_a_message_to_a_person_says_what_to_do_behind_a_semicolon() -> None:
    reported = {"fail"} | derived(REPORTED) - derived(ADVISED_ELSEWHERE)
    silent = [
        f"{show(path)}:{node.lineno}"
        for path in sources()
        for node in nodes_of(path)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name | ast.Attribute)
        and (name := node.func.id if isinstance(node.func, ast.Name) else node.func.attr)
        in reported
        and not says_what_to_do(node, name)
    ]
    assert silent == [], "write `<part>: <fact>; <what to do>`"


def test_only_the_command_line_prints() -> None:
    wrong = [
        f"{show(path)}:{node.lineno}"
        for path in sources()
        if room_of(module_of(path)) not in MAY_PRINT
        for node in nodes_of(path)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id in {"print", "input"}
    ]
    assert not wrong, "\n".join(wrong)


def test_no_file_tells_of_somebodys_machine_or_of_how_the_project_came_to_be() -> None:
    kept = (
        path
        for folder in ("src", "tests", "docs", "examples", "benchmarks", ".")
        for path in (ROOT / folder).glob("*" if folder == "." else "**/*")
        if path.is_file() and path.suffix in TEXT_SUFFIXES
    )
    wrong = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()[:80]}"
        for path in sorted(kept)
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if PRIVATE.search(line)
    ]
    assert not wrong, "\n".join(wrong)
