"""Writing descriptions back: the tree as text and the URDF artefact."""

from __future__ import annotations

from pathlib import Path

from agribot.core.robot import Joint, RobotSpec
from agribot.description.fixture import FixtureSpec
from agribot.description.loader import export_urdf
from agribot.description.package import ROOT

ARTEFACT = ROOT / "urdf" / "agribot.urdf"


def format_tree(robot: RobotSpec | FixtureSpec) -> str:
    """Format links and joints as an indented tree, with the pose of each link in its parent."""
    children = {joint.child for joint in robot.joints}
    lines = [robot.name]
    for link in robot.links:
        if link.name not in children:
            lines.append(link.name)
            lines += _format_branches(robot, link.name, "")
    return "\n".join(lines)


def _format_branches(robot: RobotSpec | FixtureSpec, parent: str, indent: str) -> list[str]:
    below = [joint for joint in robot.joints if joint.parent == parent]
    lines = []
    for joint in below:
        last = joint is below[-1]
        lines.append(f"{indent}{'└── ' if last else '├── '}{_format_branch(robot, joint)}")
        lines += _format_branches(robot, joint.child, indent + ("    " if last else "│   "))
    return lines


def _format_branch(robot: RobotSpec | FixtureSpec, joint: Joint) -> str:
    xyz = " ".join(f"{value:.4g}" for value in joint.origin.xyz_m)
    rpy = " ".join(f"{value:.4g}" for value in joint.origin.rpy_rad)
    mass_kg = robot.link(joint.child).mass_kg
    mass = f", {mass_kg:.4g} kg" if mass_kg else ""
    return f"{joint.child} ({joint.kind}; xyz {xyz} m, rpy {rpy} rad{mass})"


def write_artefact(path: Path = ARTEFACT) -> Path:
    """Write the expanded URDF for tools without xacro."""
    path.write_text(export_urdf(), encoding="utf-8")
    return path


if __name__ == "__main__":
    write_artefact()
