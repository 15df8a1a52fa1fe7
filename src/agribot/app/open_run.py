"""A run on the platform that its settings choose."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import msgspec

from agribot.app import whole_job
from agribot.app.place_memory import PlaceMemory
from agribot.app.platform_lock import PlatformLock
from agribot.app.run import Run
from agribot.app.run_setup import RunSetup, prepare_run
from agribot.app.simulated_run import SimulatedRun
from agribot.app.stop_memory import StopMemory
from agribot.app.whole_job import JobSoFar
from agribot.autonomy.plan.mission.saved_mission import SavedMission
from agribot.core.config import RunConfig
from agribot.core.platforms import require_platform


def open_run(
    config: RunConfig,
    out_dir: Path,
    saved: SavedMission | None = None,
    earlier: JobSoFar = whole_job.NOTHING,
    plan_text: str = "",
    *,
    is_armed: bool = False,
    is_cleared: bool = False,
) -> Run:
    """Prepare a run on the platform of its settings; the arguments are those of `prepare_run`.

    A platform that needs arming begins stopped, unless a person says that it `is_armed`, and that
    the stop of an earlier run `is_cleared`.

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
        place = None
        if kind.needs_arming:
            place, setup = _recall_place(setup)
            opened.callback(place.close)
        stack = setup.build_stack()  # first: it moves nothing if it is refused
        opened.callback(stack.close)
        platform = open_platform(setup.config, setup.robot)
        opened.callback(platform.close)
        memory = None
        if kind.needs_arming:
            memory = StopMemory(setup.config.platform, out_dir)
            opened.callback(memory.close)
            memory.hold_back(
                platform.inbox, is_armed=is_armed, is_cleared=is_cleared,
                saved_stop=None if saved is None else saved.stop,
            )  # fmt: skip
        run = Run(setup, platform, stack)
        run.add_close(lock.close)
        if memory is not None:
            memory.on_failure = run.report_problem
        _keep_in([memory, place], run)
        opened.pop_all()
    return run


def _keep_in(memories: Sequence[StopMemory | PlaceMemory | None], run: Run) -> None:
    """Let memories follow a run and end with it."""
    for memory in memories:
        if memory is not None:
            run.add_tap(memory)
            run.add_close(memory.close)


def _recall_place(setup: RunSetup) -> tuple[PlaceMemory, RunSetup]:
    """Let the settings know where the last run left the machine."""
    place = PlaceMemory(setup.config.platform, setup.config.field)
    config = msgspec.structs.replace(setup.config, field=place.recall())
    return place, setup._replace(config=config)
