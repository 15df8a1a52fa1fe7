"""A run on the platform that its settings choose."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from agribot.app import whole_job
from agribot.app.platform_lock import PlatformLock
from agribot.app.run import Run
from agribot.app.run_setup import prepare_run
from agribot.app.simulated_run import SimulatedRun
from agribot.app.whole_job import JobSoFar
from agribot.autonomy.plan.saved_mission import SavedMission
from agribot.core.config import RunConfig
from agribot.core.platforms import require_platform


def open_run(
    config: RunConfig,
    out_dir: Path,
    saved: SavedMission | None = None,
    earlier: JobSoFar = whole_job.NOTHING,
    plan_text: str = "",
) -> Run:
    """Prepare a run on the platform of its settings; the arguments are those of `prepare_run`.

    Raises: AgribotError: the settings do not fit, the platform cannot be opened, or another process
        drives it.
    """
    kind = require_platform(config.platform)
    setup = prepare_run(config, out_dir, saved, earlier, plan_text)
    if kind.is_simulated:
        return SimulatedRun(setup)
    open_platform = kind.find_opener()
    with ExitStack() as opened:
        lock = PlatformLock(setup.config.platform)
        opened.callback(lock.close)
        stack = setup.build_stack()  # first: it moves nothing if it is refused
        opened.callback(stack.close)
        platform = open_platform(setup.config, setup.robot)
        opened.callback(platform.close)
        run = Run(setup, platform, stack)
        run.add_close(lock.close)
        opened.pop_all()
    return run
