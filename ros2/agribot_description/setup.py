"""Installs launch files and view, and the one description of the robot from beside this package."""

import os
from pathlib import Path

from setuptools import setup

NAME = "agribot_description"
HERE = Path(__file__).resolve().parent
DESCRIPTION = HERE.parents[1] / "src" / "agribot" / "description"


def files(folder: Path, pattern: str) -> list[str]:
    """Relative to this package, as setuptools wants them."""
    return [os.path.relpath(path, HERE) for path in sorted(folder.glob(pattern))]


setup(
    name=NAME,
    version="0.2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", files(HERE / "launch", "*.launch.py")),
        (f"share/{NAME}/rviz", files(HERE / "rviz", "*.rviz")),
        (f"share/{NAME}/urdf", files(DESCRIPTION / "urdf", "*")),
        (f"share/{NAME}/meshes", files(DESCRIPTION / "meshes", "*")),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="The AGRIBOT developers",
    maintainer_email="agribot@example.org",
    description="AGRIBOT in ROS 2: description, launch files and an RViz view.",
    license="Apache-2.0",
)
