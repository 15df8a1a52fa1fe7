"""How much faster the codecs of drivers are than the lines they read, per CPU second.

`python benchmarks/codecs.py [SECONDS]`. A line of 115200 baud carries 11,520 bytes a second;
corrections over NTRIP come with a few kilobytes a second.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.drivers.codecs import BAUD, CODECS, measure_ratio


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    ratios = {codec: round(measure_ratio(codec, seconds)) for codec in CODECS}
    for codec, ratio in ratios.items():
        sys.stderr.write(f"{codec:11} {ratio:6} x a line of {BAUD[codec]} baud\n")
    sys.stdout.write(json.dumps({"line_rate_ratio": ratios}) + "\n")


if __name__ == "__main__":
    main()
