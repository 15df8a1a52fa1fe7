"""People and animals that walk: SDF's <actor> with waypoints, as figures of packaged models."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from itertools import pairwise

from agribot.core.messages import FloatArray
from agribot.core.robot import Shape
from agribot.core.world import Walker, Waypoint
from agribot.description.elements import SourceFile
from agribot.description.package import ROOT
from agribot.description.poses import extract_yaw, read_pose
from agribot.description.sdf_library import ModelLibrary
from agribot.description.sdf_models import qualify_tag, read_parts

PERSON = "person_walking"
MOST_WAYPOINTS = 10_000
FIGURES = ("person_walking", "person_standing", "person_kneeling", "dog", "hare", "crate")


def read_walkers(
    world: ET.Element, source: SourceFile, library: ModelLibrary, map_from_world: FloatArray
) -> tuple[Walker, ...]:
    """Read the actors of a world, each with a name of its own.

    Waypoints are places in the world, as for Gazebo; heights are not read, figures stand on the
    ground. An actor without waypoints stands where its <pose> says.
    """
    walkers: list[Walker] = []
    seen: Counter[str] = Counter()
    for actor in world.findall("actor"):
        with source.attempt(actor):
            walker = _read_walker(actor, source, library, map_from_world)
            number = seen[walker.name]
            seen[walker.name] += 1
            if number:
                walker = _rename(walker, f"{walker.name}_{number}")
                source.warn(f"the name of an actor is taken; this one is '{walker.name}'", actor)
            walkers.append(walker)
    return tuple(walkers)


def _rename(walker: Walker, name: str) -> Walker:
    return Walker(
        name=name, kind=walker.kind, shapes=walker.shapes, waypoints=walker.waypoints,
        loops=walker.loops, delay_s=walker.delay_s,
    )  # fmt: skip


def _read_walker(
    actor: ET.Element, source: SourceFile, library: ModelLibrary, map_from_world: FloatArray
) -> Walker:
    name = actor.get("name", "actor")
    where = f"actor '{name}'"
    kind = (actor.findtext(qualify_tag("kind")) or "").strip()
    if not kind:
        kind = _guess_figure(actor, library)
        source.warn(f"{where} is seen and touched as the packaged '{kind}'; its skin is not read")
    script = actor.find("script")
    is_idle = script is None or not _is_true(script, "auto_start", source, where)
    waypoints = _read_waypoints(actor, source, map_from_world, where)
    return Walker(
        name=name,
        kind=kind,
        shapes=_read_figure(kind, source, library, where),
        waypoints=waypoints[:1] if is_idle else waypoints,
        loops=script is not None and _is_true(script, "loop", source, where),
        delay_s=0.0 if script is None else _read_delay_s(script, source, where),
    )


def _guess_figure(actor: ET.Element, library: ModelLibrary) -> str:
    """Return the packaged figure that the words of an actor's name or skin suggest."""
    for text in (actor.findtext("skin/filename", ""), actor.get("name", "")):
        model = library.find_of_kind(text)
        if model is not None and model.get("name") in FIGURES:
            return str(model.get("name"))
    return PERSON


def _read_figure(
    kind: str, source: SourceFile, library: ModelLibrary, where: str
) -> tuple[Shape, ...]:
    model = library.find(f"model://{kind}")
    if model is None:
        raise source.fail(where, f"no model folder has '{kind}'; use person_walking, dog or hare")
    shapes = tuple(part.shape for part in read_parts(model, source, library).shapes)
    if not shapes:
        raise source.fail(where, f"model '{kind}' has no parts; choose another figure")
    return shapes


def load_figure(kind: str) -> tuple[Shape, ...]:
    """Load the parts of a packaged figure.

    Raises: DescriptionError: there is no such model.
    """
    folder = ROOT / "models"
    return _read_figure(kind, SourceFile(str(folder)), ModelLibrary(folder / kind), "figure")


def _is_true(script: ET.Element, tag: str, source: SourceFile, where: str) -> bool:
    text = script.findtext(tag, "true").strip().lower()
    if text not in {"true", "false", "1", "0"}:
        raise source.fail(where, f"<{tag}> is '{text}'; write true or false")
    return text in {"true", "1"}


def _read_delay_s(script: ET.Element, source: SourceFile, where: str) -> float:
    delay_s = source.parse_number(script.findtext("delay_start", "0"), f"{where} <delay_start>")
    if delay_s < 0.0:
        raise source.fail(where, f"<delay_start> is {delay_s:g} s; it must be 0 or more")
    return delay_s


def _read_waypoints(
    actor: ET.Element, source: SourceFile, map_from_world: FloatArray, where: str
) -> tuple[Waypoint, ...]:
    found = []
    for element in actor.findall("script/trajectory/waypoint"):
        t_s = source.parse_number(element.findtext("time"), f"{where} <time>")
        found.append(_make_waypoint(t_s, map_from_world @ read_pose(element, source, where)))
    if len(found) > MOST_WAYPOINTS:
        raise source.fail(where, f"{len(found)} waypoints; at most {MOST_WAYPOINTS} are read")
    for before, after in pairwise([-1e-9, *(point.t_s for point in found)]):
        if after <= before:
            raise source.fail(
                where,
                f"the waypoint at {after:g} s is not after {max(before, 0.0):g} s; order them by "
                "time, from 0 on",
            )
    return tuple(found) or (_make_waypoint(0.0, map_from_world @ read_pose(actor, source, where)),)


def _make_waypoint(t_s: float, pose: FloatArray) -> Waypoint:
    x_m, y_m = pose[:2, 3].tolist()
    return Waypoint(t_s=t_s, x_map_m=x_m, y_map_m=y_m, yaw_rad=extract_yaw(pose))
