"""Whole missions are dear: each kind runs once and many tests look at it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from agribot.record.report import Report

FarmRun = Callable[[int], tuple[Path, Report]]
ShortRun = Callable[..., tuple[Path, Report]]


def run_session(profile: str, settings: list[str], out_dir: str) -> Report:
    """Drive one session to its end in this process."""
    from agribot.app.simulated_run import simulate
    from agribot.core import config

    with simulate(config.load(profile, settings), Path(out_dir)) as session:
        for _ in session.ticks():
            pass
        return session.finish()


@pytest.fixture(scope="session")
def farm_run(tmp_path_factory: pytest.TempPathFactory) -> FarmRun:
    """`agribot run farm --sensors rtk --seed S` with camera and network, driven once per seed."""
    root = tmp_path_factory.mktemp("farm")

    @cache
    def drive(seed: int) -> tuple[Path, Report]:
        out = root / f"seed{seed}"
        return out, run_session("farm", [f"seed={seed}", 'sim.sensors="rtk"'], str(out))

    return drive


@pytest.fixture
def short_run(tmp_path: Path) -> ShortRun:
    """Run the first seconds of the farm mission with extra settings."""

    def run(name: str, *settings: str, seconds: float = 12.0) -> tuple[Path, Report]:
        out = tmp_path / name
        return out, run_session("farm", [f"duration_s={seconds}", *settings], str(out))

    return run
