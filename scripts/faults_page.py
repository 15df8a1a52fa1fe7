"""Print docs/faults.md: every fault that can be injected, from the table in the code.

`make pages` writes all such pages.
"""

from __future__ import annotations

import sys

from agribot.core.messages import WHEEL_NAMES
from agribot.lab.bench.fault_matrix import cells
from agribot.lab.bench.fault_matrix.states import STATES
from agribot.sim.faults.table import FAULTS, FaultKind, Span

HEAD = """# Faults

Written by `make pages` from the code. In the simulator, something can go wrong at a time of your
choice; the robot gets no notice of it, and the report says what the robot did about it.

```
agribot run farm --fault gnss.jump=2@30              # from 30 s of the mission until its end
agribot run farm --fault gnss.outage@30+20           # for 20 s
agribot run farm --fault start.turned=20@0 --fault motor.dead=left_wheel_F@40
agribot run farm --fault imu.bias=0.05@30~300        # rises from nothing in 300 s
agribot sweep farm --vary "faults=none,gnss.frozen@30,imu.late=0.3@30;mag.motor@40"
```

A fault is `NAME[=VALUE]@T[~RISE][+SECONDS]`, with T in simulated seconds since the start; without
`+SECONDS` it lasts to the end. With `~RISE` a value marked * grows, from what is harmless, in so
many seconds. You can give several, also to `agribot sim`, in a profile
(`faults = ["..."]`) and from Python (`RunConfig.faults`). In a sweep, a semicolon joins the faults
of one run, and `none` is a run without. The same seed gives the same faults.
What is impossible, such as an unknown name, is refused before anything moves.
A run that goes on (`--resume`) has them on the clock of its job.

A wheel is one of {wheels}. A value marked ± may be negative, one marked * may rise.

"""
TAIL = """
`events.jsonl` holds when each began and ended (kind `injected`). `safety` of
[`report.json`](recordings.md) has:

- `faults`: of each fault when the robot noticed it, what it did (`stopped`, `held`, `slowed`,
  `named`, `none`), and the reason with its `code`, `parts` and `numbers`. Noticed means: after the
  fault began, a new stop, hold, pause or failure, or a [fact](glossary.md) that names the part.
- `noticed`: all faults that the robot reported, injected or not.
- `outside_m_max`: how far any part of the robot was outside the field; without a plan, outside the
  rectangle around rows and start with `mission.headland_m`, 1.5 m and the turning circle.
- `stop_distance_m_max`, `stop_allowed_m`, `stops_too_long`: the longest way to a standstill, what
  the drive promises (more for a silent board or a tipped robot), and
  the stops that took more.
- `crushes`, `crushed_after_fault`: crops crushed since the first fault began, with time and cause;
  `when` is `before_detection`, `after_detection` while the robot still moved, `after_standstill`,
  or `by_fault`, where hands set the robot down.

## The campaign

`agribot bench faults` lets things go wrong in every state of the robot, each by a course in time,
and judges the robot until the end of its mission beside the same drive without a fault. Started
again, it goes on where it was interrupted. [What it measured](results/faults-matrix.md) last.

```
agribot bench faults                                 # a covering array: 40 minutes of a CPU
agribot bench faults --faults motor.runaway,carried --seeds 1
agribot bench faults --shard 2/4 --out shared/matrix # the second of four parts
agribot bench faults --all                           # every fault, state, course and seed
```

- **States**: {states}.
  A fault begins when the drive gets there: a person pauses, presses STOP, drives by hand, sends the
  robot to a place, or the program is killed and started again.
- **Courses**: once for {once_s:g} s; for good; {bursts} times {burst_s:g} s, every {every_s:g} s;
  rising for {rise_s:g} s where the value can.
- **Pairs**: a fault that may stay unnoticed, and another one {also_s:g} s later.

By default each two of fault, state, course and seed meet in at least one cell. A cell is **red**
where a plant was crushed after the fault was noticed or noticeable, where the robot left the field,
rolled on though it had to stand, took longer to stop than it promises, did not notice what had an
effect, named a part first that is well, or where the program failed. The folder has `matrix.csv`
with all cells.

## The campaign in a row

`agribot bench faults --in-row` drives into a row, lets one thing go wrong there for good, and
judges the robot for 45 s; also with a camera, other fields, and the board's real firmware.
[What it measured](results/fault-campaign.md) last.

```
agribot bench faults --in-row --seeds 1 --no-camera  # three minutes of a CPU
agribot bench faults --special                       # what is looked at one by one
agribot bench faults --fault-free 500                # drives in which nothing goes wrong
```

"""
COLUMNS = (
    ("detected", "share of the injected faults that the robot noticed"),
    ("named", "share for which a reason named the part at fault and no part that works"),
    ("one of two", "share for which reasons named the part only beside another, as in "
     "`camera and GNSS disagree`"),
    ("harmless", "share without notice or effect: across the row never farther off than twice "
     "the 95 % of the same drives without a fault, nothing crushed, no farther outside"),
    ("after", "median time until it was noticed"),
    ("rolled, allowed", "longest way from a stop to standstill, and what the drive promises"),
    ("crushed", "plants since the fault began: before it was noticed, until the "
     "robot was at rest, after that, and where hands set it down"),
    ("outside", "how far any part of the robot got out of the field"),
)  # fmt: skip
END = """
In `--json`, the ratios `detected_ratio`, `named_ratio` and `one_of_two_ratio` count all injected
faults, and those with `harmful_` leave out the harmless. `crushed_after_detectable` counts the
plants that were crushed after the robot had noticed, or could have: 3 s after the begin (a drift of
the receiver 10 s, an empty battery and a pole in the way 5 s).
`km_without_fault` is the way of the `missions_without_fault`.
"""


def page() -> str:
    rows = "".join(format_row(kind) for kind in FAULTS)
    heads = "| fault | what happens | values |\n|---|---|---|\n"
    columns = "".join(f"| {name} | {counts} |\n" for name, counts in COLUMNS)
    head = HEAD.format(wheels=", ".join(f"`{name}`" for name in WHEEL_NAMES))
    return (
        head
        + heads
        + rows
        + describe_campaign()
        + "| column | counts |\n|---|---|\n"
        + columns
        + END
    )


def describe_campaign() -> str:
    return TAIL.format(
        states=", ".join(state.name for state in STATES), once_s=cells.ONCE_S,
        bursts=cells.BURSTS, burst_s=cells.BURST_S, every_s=cells.EVERY_S, rise_s=cells.RISE_S,
        also_s=cells.ALSO_AFTER_S,
    )  # fmt: skip


def format_row(kind: FaultKind) -> str:
    name = kind.name if kind.value is None else f"{kind.name}={kind.typical}"
    lasts = "; from time 0" if kind.at_start else "; at once" if kind.is_momentary else ""
    return f"| `{name}` | {kind.about}{lasts} | {_show_values(kind)} |\n"


def _show_values(kind: FaultKind) -> str:
    if not isinstance(kind.value, Span):
        return kind.value or ""
    sign = "±" if kind.value.is_signed else ""
    rises = " *" if kind.can_rise else ""
    return f"{sign}{kind.value.low:g}…{kind.value.high:g} {kind.value.unit}".strip() + rises


if __name__ == "__main__":
    sys.stdout.write(page())
