"""One field and one A-B line of a file with several: `farm.zip#North`, `farm.zip#North#Line 2`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from agribot.core.errors import MissionError
from agribot.core.facts import NoSuchField, SeveralFields
from agribot.gis.formats.kinds import make_outline

Member = dict[str, Any]
# Largest share of the smaller of two fields; neighbours on a map overlap by less. A larger overlap
# is kept, so that it is refused where it crosses the boundary.
MOST_OVERLAP_RATIO = 0.05
MAX_NAMED = 20


def split_choice(path: Path) -> tuple[Path, list[str]]:
    """Split the names behind `#` from the path of a file, unless the file's own name has it."""
    text = str(path)
    places = [at for at, letter in enumerate(text) if letter == "#"]
    if path.exists() or not places:
        return path, []
    at = next((at for at in places if Path(text[:at]).is_file()), places[0])
    return Path(text[:at]), [name for name in text[at + 1 :].split("#") if name]


def list_fields(root: dict[str, Any]) -> list[str]:
    """List the names of the fields in a collection, the smaller parts of one included."""
    return [*_name_all(root["features"], "boundary", "field"), *_name_parts(root)]


def keep_field(root: dict[str, Any], name: str, shown: str) -> dict[str, Any]:
    """Keep one field, or one part of one, of a collection with all that belongs to it.

    Raises: MissionError: a name that is not there; all are listed.
    """
    features: list[Member] = root["features"]
    fields, parts = _name_all(features, "boundary", "field"), _name_parts(root)
    if name not in fields.keys() | parts.keys():
        raise MissionError(NoSuchField(shown, name, _list_names(fields | parts)))
    if name in parts:
        features = _keep_field([*features, parts[name]], parts[name])
    elif len(fields) > 1 or parts:
        features = _keep_field(features, fields[name])
    return {**_without_parts(root), "features": features}


def choose_field(root: dict[str, Any], wanted: Sequence[str], shown: str) -> dict[str, Any]:
    """Keep one field of a collection with what belongs to it, and one A-B line.

    Raises: MissionError: a name that is not there, or one is needed; all are listed.
    """
    fields, parts = _name_all(root["features"], "boundary", "field"), _name_parts(root)
    lines = _name_all(root["features"], "ab_line", "line")
    unknown = [name for name in wanted if name not in fields.keys() | parts.keys() | lines.keys()]
    if unknown:
        named = _list_names(fields | parts), _list_names(lines)
        raise MissionError(NoSuchField(shown, unknown[0], *named))
    is_part = any(name in parts for name in wanted)
    if len(fields) > 1 or is_part:
        root = keep_field(root, _choose(fields | parts, wanted, "fields", shown), shown)
    elif parts:
        root = keep_field(root, next(iter(fields)), shown)
    kept = {id(feature) for feature in root["features"]}
    lines = {name: line for name, line in lines.items() if id(line) in kept}
    features: list[Member] = root["features"]
    if len(lines) > 1:
        line = lines[_choose(lines, wanted, "lines", shown)]
        features = [f for f in features if f is line or f["properties"]["kind"] != "ab_line"]
    return {**_without_parts(root), "features": features}


def _name_parts(root: dict[str, Any]) -> dict[str, Member]:
    return {part["properties"]["name"]: part for part in root.get("parts", ())}


def _without_parts(root: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in root.items() if key != "parts"}


def _name_all(features: Sequence[Member], kind: str, what: str) -> dict[str, Member]:
    """Name what is of a kind, as the file does or by numbers; equal names are numbered, too."""
    found = [feature for feature in features if feature["properties"].get("kind") == kind]
    names = [_find_name(one) or f"{what} {number}" for number, one in enumerate(found, 1)]
    counts, seen = Counter(names), Counter[str]()
    named = {}
    for name, feature in zip(names, found, strict=True):
        seen[name] += 1
        named[f"{name} ({seen[name]})" if counts[name] > 1 else name] = feature
    return named


def _find_name(feature: Member) -> str:
    names = {str(key).lower(): value for key, value in feature["properties"].items()}
    return str(names.get("name") or names.get("field_name") or names.get("field") or "").strip()


def _choose(
    named: dict[str, Member], wanted: Sequence[str], what: Literal["fields", "lines"], shown: str
) -> str:
    chosen = [name for name in wanted if name in named]
    if len(chosen) == 1:
        return chosen[0]
    example = f"{shown}#{next(iter(named))}"
    raise MissionError(SeveralFields(shown, len(named), what, _list_names(named), example))


def _list_names(named: dict[str, Member]) -> str:
    names = [f"'{name}'" for name in named]
    more = [f"{len(names) - MAX_NAMED} more"] if len(names) > MAX_NAMED else []
    return ", ".join([*names[:MAX_NAMED], *more]) or "none"


def _keep_field(features: Sequence[Member], field: Member) -> list[Member]:
    """Keep what belongs to a field; another one that reaches into it is an obstacle there."""
    return [
        f if f is field or f["properties"]["kind"] != "boundary" else _as_obstacle(f)
        for f in features
        if f is field or _belongs(f, field)
    ]


def _as_obstacle(feature: Member) -> Member:
    return {**feature, "properties": {**feature["properties"], "kind": "obstacle"}}


def _belongs(feature: Member, field: Member) -> bool:
    """Return whether a feature belongs to a field, by its file's reference or by its place."""
    from shapely.geometry import shape

    partfield = feature["properties"].get("partfield")
    if partfield is not None:
        return bool(partfield == field["properties"].get("partfield"))
    outline = make_outline(field["geometry"])
    if feature["geometry"]["type"] != "Polygon":
        return bool(shape(feature["geometry"]).intersects(outline))
    other = make_outline(feature["geometry"])
    shared = other.intersection(outline).area
    return bool(shared > MOST_OVERLAP_RATIO * min(other.area, outline.area))
