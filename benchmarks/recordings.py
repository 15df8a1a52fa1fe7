"""What recording costs, a million small messages, and a real run killed many times.

PYTHONPATH=. python benchmarks/recordings.py [--messages 1000000] [--kills 20] [--no-cost]
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
from pathlib import Path

from msgspec.structs import replace

from agribot.core import topics
from agribot.core.config import load
from agribot.core.messages import CameraFrame
from agribot.description.loader import load_robot
from agribot.description.worlds_sdf import load_world
from agribot.record.bag.convert import convert
from agribot.record.bag.info import read_info
from agribot.record.mcap_file import McapFile
from agribot.record.recorder import RunRecorder
from agribot.ros.messages import rosmsg
from agribot.sim.platform import SimPlatform
from tests.record import record_samples as samples
from tests.record.killed_run import kill_a_run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--messages", type=int, default=1_000_000)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--no-cost", action="store_true")
    options = parser.parse_args()
    if not options.no_cost:
        measure_cost()
    with tempfile.TemporaryDirectory() as name:
        if options.messages:
            record_many_messages(Path(name), options.messages)
        if options.kills:
            kill_recordings(Path(name), options.kills)


def record_many_messages(folder: Path, count: int) -> None:
    data = rosmsg.to_cdr(rosmsg.make_float64(1.5))
    file = McapFile(folder / "many.mcap")
    time_call(
        "write .mcap", lambda: [file.write(topics.DISTANCE, i, data, i) for i in range(count)]
    )
    file.close()
    time_call("info .mcap", lambda: read_info(folder / "many.mcap"))
    time_call("to .bag", lambda: convert(folder / "many.mcap", folder / "many.bag"))
    time_call("info .bag", lambda: read_info(folder / "many.bag"))
    time_call("to .db3", lambda: convert(folder / "many.bag", folder / "many.db3"))
    time_call("back to .mcap", lambda: convert(folder / "many.db3", folder / "back.mcap"))
    assert read_info(folder / "back.mcap").messages == count


def kill_recordings(folder: Path, count: int) -> None:
    dice = random.Random(1)
    worst_s = 0.0
    for number in range(count):
        killed = kill_a_run(folder / f"kill{number}", dice.uniform(0.1, 6.0))
        worst_s = max(worst_s, killed.lost_s)
        sys.stdout.write(
            f"kill {number + 1:2}: {killed.ran_s:5.2f} s driven, {killed.kept_s:5.2f} s kept, "
            f"{killed.recovered} messages recovered {' '.join(killed.notes)}\n"
        )
    sys.stdout.write(f"at most {worst_s:.2f} s of {count} runs were lost\n")


def measure_cost() -> None:
    """All topics, with the camera at 30 Hz and without, in shares of one core."""
    config = load("farm")
    robot = load_robot(config.robot)
    assert robot.camera is not None
    world = load_world("Farm", seed=0, weed_density_per_m2=None)
    platform = SimPlatform(config, robot, world)
    pictures: list[CameraFrame] = []
    while len(pictures) < 8:
        pictures += platform.read().frames
    for rate_hz in (0, 1, 30):
        settings = load("farm", [f"record.image_rate_hz={rate_hz}"])
        with tempfile.TemporaryDirectory() as name:
            recorder = RunRecorder(Path(name) / "run.mcap", settings, robot, samples.URDF)
            ticks_s = []
            for index, record in enumerate(samples.ticks(1500, seed=1)):
                is_due = index * 30 // 50 != (index - 1) * 30 // 50
                frame = replace(pictures[index % 8], t_s=record.batch.t_s, index=index)
                batch = replace(record.batch, frames=(frame,) if is_due else ())
                started_s = time.thread_time()
                recorder(replace(record, batch=batch, scenes=()))
                ticks_s.append(time.thread_time() - started_s)
            recorder.close()
        ordered = sorted(ticks_s[50:])
        share = sum(ordered) / (len(ordered) * 0.02)
        sys.stdout.write(
            f"camera at {rate_hz:2} Hz: {100 * share:.1f} % of a core, a tick "
            f"{1e3 * ordered[len(ordered) // 2]:.2f} ms, 99 % of them below "
            f"{1e3 * ordered[len(ordered) * 99 // 100]:.2f} ms\n"
        )


def time_call(name: str, work: object) -> None:
    started_s = time.process_time()
    assert callable(work)
    work()
    sys.stdout.write(f"{name:14} {time.process_time() - started_s:7.2f} CPU s\n")


if __name__ == "__main__":
    main()
