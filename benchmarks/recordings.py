"""How recordings behave at scale: a million small messages, and a real run killed many times.

python benchmarks/recordings.py [--messages 1000000] [--kills 20]
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from agribot import topics
from agribot.record import rosmsg
from agribot.record.bag.convert import convert
from agribot.record.bag.info import read_info
from agribot.record.mcap_file import McapFile
from agribot.record.recovery import recover
from agribot.record.replay import read_ticks


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--messages", type=int, default=1_000_000)
    parser.add_argument("--kills", type=int, default=20)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        if options.messages:
            many_messages(Path(name), options.messages)
        if options.kills:
            kills(Path(name), options.kills)


def many_messages(folder: Path, count: int) -> None:
    data = rosmsg.to_cdr(rosmsg.float64(1.5))
    file = McapFile(folder / "many.mcap")
    timed("write .mcap", lambda: [file.write(topics.DISTANCE, i, data, i) for i in range(count)])
    file.close()
    timed("info .mcap", lambda: read_info(folder / "many.mcap"))
    timed("to .bag", lambda: convert(folder / "many.mcap", folder / "many.bag"))
    timed("info .bag", lambda: read_info(folder / "many.bag"))
    timed("to .db3", lambda: convert(folder / "many.bag", folder / "many.db3"))
    timed("back to .mcap", lambda: convert(folder / "many.db3", folder / "back.mcap"))
    assert read_info(folder / "back.mcap").messages == count


def kills(folder: Path, count: int) -> None:
    dice = random.Random(1)
    for number in range(count):
        out = folder / f"kill{number}"
        command = [
            sys.executable, "-m", "agribot.cli", "run", "farm", "--speed", "1",
            "--set", "perception.enabled=false", "--out", str(out),
        ]  # fmt: skip
        process = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        while not (out / "run.mcap").exists():
            time.sleep(0.05)
        started_s = time.monotonic()
        time.sleep(dice.uniform(0.5, 6.0))
        process.kill()
        ran_s = time.monotonic() - started_s
        process.wait()
        ticks = list(read_ticks(out / "run.mcap"))
        kept_s = ticks[-1].batch.t_s if ticks else 0.0
        saved = recover(out / "run.mcap", out / "saved.mcap")
        sys.stdout.write(
            f"kill {number + 1:2}: {ran_s:5.2f} s after the file was made, {kept_s:5.2f} s kept, "
            f"{saved.messages} messages recovered\n"
        )


def timed(name: str, work: object) -> None:
    started_s = time.process_time()
    assert callable(work)
    work()
    sys.stdout.write(f"{name:14} {time.process_time() - started_s:7.2f} CPU s\n")


if __name__ == "__main__":
    main()
