"""Descriptions of what stands: a pole, a gate, a station, with the receivers on it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence

import msgspec

from agribot.core.errors import DescriptionError
from agribot.core.robot import Joint, Link
from agribot.description.elements import SourceFile
from agribot.description.kinematics import read_joints, read_links
from agribot.description.tags import (
    DRIVE_PLUGINS,
    GNSS,
    TagBlock,
    find_plugin,
    iterate_gazebo_blocks,
)

STATION = "--set 'sim.base_station=\"common\"'"


class FixtureReceiver(msgspec.Struct, frozen=True, kw_only=True):
    """A GNSS receiver on a fixture: its link, rate and topics, and how high over the root it is."""

    link: str
    rate_hz: float
    topics: tuple[str, ...]
    height_m: float


class FixtureSpec(msgspec.Struct, frozen=True, kw_only=True):
    """Something without wheels or moving joints."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    receivers: tuple[FixtureReceiver, ...] = ()
    warnings: tuple[str, ...] = ()

    def link(self, name: str) -> Link:
        return next(link for link in self.links if link.name == name)

    @property
    def mass_kg(self) -> float:
        return sum(link.mass_kg for link in self.links)

    def describe(self) -> str:
        """Describe it in a few lines for a person."""
        lines = [
            f"{self.name}: {len(self.links)} links, {len(self.joints)} joints, "
            f"{self.mass_kg:.3f} kg",
            "it has no wheels: it stands where a world puts it",
        ]
        lines += [
            f"GNSS receiver on {r.link}, {r.height_m:.3f} m over its origin, {r.rate_hz:g} Hz: "
            f"{', '.join(r.topics)}"
            for r in self.receivers
        ]
        if self.receivers:
            lines.append(f"as base station of a simulation: {STATION}")
        return "\n".join(lines) + "\n"


def is_fixture(root: ET.Element, source: SourceFile) -> bool:
    """Return whether nothing in a URDF tree moves, and nothing says that it should drive."""
    has_moving = any(joint.get("type") != "fixed" for joint in root.findall("joint"))
    has_wheel = any("wheel" in link.get("name", "").lower() for link in root.findall("link"))
    drives = find_plugin(root, DRIVE_PLUGINS, source) is not None
    return root.find("link") is not None and not (has_moving or has_wheel or drives)


def refuse_fixture(root: ET.Element, source: SourceFile) -> None:
    """Refuse to drive what stands.

    Raises: DescriptionError: the tree is a fixture; the text says what it can be used for.
    """
    if is_fixture(root, source):
        raise source.fail(
            f"'{root.get('name', source.file)}'",
            "it has no wheels and no joint that moves: it stands, and cannot be driven (four wheel "
            "joints at the corners are needed to drive); choose a robot, such as agribot. With a "
            f"receiver it serves as base station: {STATION}",
        )


def read_fixture(root: ET.Element, source: SourceFile) -> FixtureSpec:
    """Read a tree that `is_fixture`.

    Raises: DescriptionError: a link or joint is broken, or a receiver sits on no link of it.
    """
    links, joints = read_links(root, source), read_joints(root, source)
    for link in links:
        if link.mass_kg < 0.0:
            raise source.fail(
                f"link '{link.name}'", f"a mass of {link.mass_kg:g} kg; give 0 or more"
            )
    receivers = tuple(_read_receivers(root, links, joints, source))
    return FixtureSpec(
        name=root.get("name", source.file),
        links=links,
        joints=joints,
        receivers=receivers,
        warnings=source.list_warnings(),
    )


def _read_receivers(
    root: ET.Element, links: Sequence[Link], joints: Sequence[Joint], source: SourceFile
) -> Iterator[FixtureReceiver]:
    for block in _list_receiver_blocks(root, source):
        name = block.tags.get("bodyname") or block.link
        if name not in {link.name for link in links}:
            raise source.fail(block.what, f"there is no link '{name}'; name that of the receiver")
        yield FixtureReceiver(
            link=name,
            rate_hz=block.read_positive("updateRate"),
            topics=tuple(_list_topics(block)),
            height_m=_find_height_m(name, joints),
        )


def _list_receiver_blocks(root: ET.Element, source: SourceFile) -> Iterator[TagBlock]:
    for link, block in iterate_gazebo_blocks(root):
        for plugin in block.iter("plugin"):
            file = plugin.get("filename", "")
            if any(part in file.lower() for part in GNSS.plugins):
                yield TagBlock(plugin, f"plugin '{file}'", source, link)


def _list_topics(block: TagBlock) -> Iterator[str]:
    space = block.tags.get("robotnamespace", "").strip("/")
    for tag in ("topicname", "velocitytopicname"):
        name = block.tags.get(tag, "").strip("/")
        if name:
            yield f"/{space}/{name}" if space else f"/{name}"


def _find_height_m(name: str, joints: Sequence[Joint]) -> float:
    """Find how high a link is over the root of its tree, of joints that do not tilt."""
    parents = {joint.child: joint for joint in joints}
    height_m = 0.0
    while name in parents:
        height_m += parents[name].origin.xyz_m[2]
        name = parents[name].parent
    return height_m


def refuse_form(fixture: FixtureSpec, form: str) -> DescriptionError:
    """Return the error for a form that only robots have."""
    return DescriptionError(
        f"{fixture.name}: {form} is for robots, and this has no wheels; take --urdf, --tree or "
        "--json"
    )
