"""Whole missions are dear: each kind runs once and many tests look at it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest

from agribot.record.report import Report

FARM_SEEDS = (1, 2, 3, 4, 5)


def run_session(profile: str, settings: list[str], out_dir: str) -> Report:
    """Drive one session to its end in this process."""
    from agribot.app.simulated_run import simulate
    from agribot.core import config

    with simulate(config.load(profile, settings), Path(out_dir)) as session:
        for _ in session.ticks():
            pass
        return session.finish()


@pytest.fixture(scope="session")
def farm_runs(tmp_path_factory: pytest.TempPathFactory) -> dict[int, tuple[Path, Report]]:
    """`agribot run farm --sensors rtk --seed S` with camera and network, for five seeds."""
    root = tmp_path_factory.mktemp("farm")
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        running = {
            seed: pool.submit(
                run_session,
                "farm",
                [f"seed={seed}", 'sim.sensors="rtk"'],
                str(root / f"seed{seed}"),
            )
            for seed in FARM_SEEDS
        }
        return {seed: (root / f"seed{seed}", job.result()) for seed, job in running.items()}


@pytest.fixture
def short_run(tmp_path: Path) -> Callable[..., tuple[Path, Report]]:
    """Run the first seconds of the farm mission with extra settings."""

    def run(name: str, *settings: str, seconds: float = 12.0) -> tuple[Path, Report]:
        out = tmp_path / name
        return out, run_session("farm", [f"duration_s={seconds}", *settings], str(out))

    return run
