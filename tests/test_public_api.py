"""The names that `import agribot` offers, and that programs may rely on."""

from __future__ import annotations

import subprocess
import sys

import pytest

import agribot

NAMES = {
    "AgribotError", "Correction", "Implement", "ImplementKind", "ImplementSpec", "OperatorPage",
    "Platform", "RobotCommand", "RobotSpec", "Run", "RunConfig", "SensorBatch", "SensorSource",
    "SimulatedRun", "TickRecord", "Who", "__version__", "load", "load_robot", "messages",
    "open_run", "panels", "register_correction", "register_implement", "register_platform",
    "register_scheme", "simulate", "topics",
}  # fmt: skip


def test_the_public_names_are_these_and_no_others() -> None:
    assert set(agribot.__all__) == NAMES == set(dir(agribot))


@pytest.mark.parametrize("name", sorted(NAMES))
def test_every_public_name_can_be_imported(name: str) -> None:
    found = getattr(agribot, name)
    assert found is not None
    assert name == "__version__" or found.__doc__


def test_a_name_that_is_none_is_told_by_its_name() -> None:
    with pytest.raises(AttributeError, match="'agribot' has no attribute 'banana'"):
        agribot.banana  # noqa: B018


def test_the_face_loads_nothing_before_it_is_asked_for_something() -> None:
    code = "import sys, agribot; print([m for m in sys.modules if m.startswith('agribot.')])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "['agribot.core', 'agribot.core.version']"
