"""How much faster the codecs of drivers are than the lines they read, per CPU second.

`python benchmarks/codecs.py [SECONDS]`. A line of 115200 baud carries 11,520 bytes a second;
corrections over NTRIP come with a few kilobytes a second.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.drivers import fuzzing
from tests.drivers.caster import YES, chunk, make_observation

LINE_BYTES_PER_S = 11_520
PIECE = 256  # what a read of a busy line gives


def measure_ratio(codec: str, seconds: float) -> float:
    """Measure bytes per CPU second of what the codec is there for, over those of a line."""
    seeds = fuzzing.write_seeds(codec)
    data = max(seeds, key=len) if codec in ("ubx", "nmea") else b"".join(seeds)
    head = b""
    if codec == "ntrip":  # the head is read once, the corrections for hours
        head, data = YES + b"Transfer-Encoding: chunked\r\n\r\n", chunk(make_observation())
    pieces = [data[k : k + PIECE] for k in range(0, len(data), PIECE)]
    count, started_s = 0, time.process_time()
    while time.process_time() - started_s < seconds:
        feed = fuzzing.CODECS[codec]()
        feed(head)
        for _ in range(20):
            for piece in pieces:
                feed(piece)
                count += len(piece)
    return count / (time.process_time() - started_s) / LINE_BYTES_PER_S


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    ratios = {codec: round(measure_ratio(codec, seconds)) for codec in fuzzing.CODECS}
    for codec, ratio in ratios.items():
        sys.stderr.write(f"{codec:11} {ratio:6} x a line of 115200 baud\n")
    sys.stdout.write(json.dumps({"line_rate_ratio": ratios}) + "\n")


if __name__ == "__main__":
    main()
