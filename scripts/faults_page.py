"""Print docs/faults.md: every fault that can be injected, from the table in the code.

`make pages` writes all such pages.
"""

from __future__ import annotations

import sys

from agribot.sim.faults.schedule import describe_value
from agribot.sim.faults.table import FAULTS, FaultKind

HEAD = """# Faults

Written by `make pages` from the code. In the simulator, something can go wrong at a time of your
choice; the robot gets no notice of it, and the report says what the robot did about it.

```
agribot run farm --fault gnss.jump=2@30              # from 30 s of the mission until its end
agribot run farm --fault gnss.outage@30+20           # for 20 s
agribot run farm --fault start.turned=20@0 --fault motor.dead=left_wheel_F@40
agribot sweep farm --vary "faults=none,gnss.frozen@30,imu.late=0.3@30;mag.motor@40"
```

A fault is `NAME[=VALUE]@T[+SECONDS]`, with T in simulated seconds since the start; without
`+SECONDS` it lasts to the end. `--fault` may be given several times, also to `agribot sim`; it adds
to `faults = ["..."]` of the profile. Where a sweep varies faults, a semicolon joins those of one
run, and `none` is a run without. From Python they are `RunConfig.faults`.
What cannot be (an unknown name, a value out of range, a time after the end of the run, a fault of
a camera that is not there, a platform that is not the simulator) is refused before anything moves.

The same seed gives the same faults. A run that goes on (`--resume`) has them on the clock of its
job: those that are over or happened at once are past, others go on, a frozen sensor with new
numbers.

"""
TAIL = """
`events.jsonl` holds when each began and ended (kind `injected`). `safety.faults` of
[`report.json`](recordings.md) says of each when the robot noticed it, what it did (`stopped`,
`held`, `slowed`, `named` only, or `none`) and the reason that it gave; `outside_m_max`,
`stop_distance_m_max` and `crushed_after_fault` say what it cost, by the truth. Noticed means: after
the fault began, a stop, hold, pause or failure that had not been there before, or a fault or a
limit whose reason names the part. `safety.noticed` are all faults that the robot reported, injected
or not.

`outside_m_max` is of the robot's whole rectangle, implement included, against the field's boundary
and holes; without a plan against the rectangle around rows and start with `mission.headland_m`,
1.5 m and the circle on which the robot turns. A way into the field is not outside.
`stop_allowed_m` is what the drive promises at the speed of the longest stop: 0.2 s until the
brakes bite, then `max_accel_mps2`; `stops_too_long` counts the
stops that took more. `crushes` are the crops crushed since the first fault began, each with its
time, what crushed it, and `when`: `before_detection`, `after_detection` while the robot still
rolled or drove on, `after_standstill`, or `by_fault`, which lay where hands set the robot down.

## The campaign

`agribot bench faults` drives into a row, lets one thing go wrong there, and judges the robot. The
same drives without a fault stand beside them: what stops the robot there is a false alarm. It goes
on where it was interrupted; its table is `faults.md` in the folder. `--markdown PAGE` writes the
summary and the open rows between the marks of a page, and all rows into the `.csv` file beside it.

```
agribot bench faults --seeds 1 --no-camera           # three minutes of a CPU
agribot bench faults --faults gnss.wrong_fix,carried
agribot bench faults --special                       # what is looked at one by one
agribot bench faults --fault-free 500                # drives in which nothing goes wrong
```

"""
COLUMNS = (
    ("detected", "the share of the injected faults that the robot noticed"),
    ("named", "the share for which a reason named the part at fault and no part that works"),
    ("one of two", "the share for which reasons named the part only beside another, as in "
     "`camera and GNSS disagree` or `GNSS jumped ..., or the robot was carried`"),
    ("harmless", "the share that had no notice and no effect: across the row never farther "
     "off than twice what 95 % of the ticks of the same drives without a fault are, or than the "
     "worst of them; nothing crushed, and no farther outside"),
    ("after", "the median time until it was noticed"),
    ("rolled, allowed", "the longest way from a stop to standstill, and what the drive promises at "
     "that speed"),
    ("crushed", "all plants since the fault began, and when: before it was noticed, then until the "
     "robot was at rest, after that, and where hands set the robot down"),
    ("outside", "how far any place of the robot, implement included, got out of the field"),
)  # fmt: skip
END = """
Each fault belongs to a part, some to two (a motor at fault shows in its wheel). What the robot
reports is a [fact](glossary.md) with the parts that are at fault, those of the facts inside it
included; a part that it is only compared with is not among them. These are compared with the part
of the fault; no word of the text is looked at. `safety.faults` has the `code`, the `parts` and the
`numbers` of the fact beside its text.

In `--json`, `detected_ratio`, `named_ratio` and `one_of_two_ratio` are of all injected faults,
`harmful_detected_ratio`, `harmful_named_ratio` and `harmful_one_of_two_ratio` leave out the
harmless. `crushed_after_detectable` counts the plants that
were crushed after the robot had noticed, or could have: 3 s after the begin (a drift of the
receiver 10 s, an empty battery and a pole in the way 5 s), but for a creeping receiver and a weak
motor, which no sensor on board shows. What lies where hands set the robot down does not count.
`km_without_fault` is the way of the `missions_without_fault`.

[What it measured](results/fault-campaign.md) last. Which of them proves which [hazard](hazards.md).
"""


def page() -> str:
    rows = "".join(format_row(kind) for kind in FAULTS)
    heads = "| fault | what happens | value | lasts |\n|---|---|---|---|\n"
    columns = "".join(f"| {name} | {counts} |\n" for name, counts in COLUMNS)
    return HEAD + heads + rows + TAIL + "| column | counts |\n|---|---|\n" + columns + END


def format_row(kind: FaultKind) -> str:
    name = kind.name if kind.value is None else f"{kind.name}={kind.typical}"
    lasts = "from time 0" if kind.at_start else "at once" if kind.is_momentary else "as given"
    return f"| `{name}` | {kind.about} | {describe_value(kind)} | {lasts} |\n"


if __name__ == "__main__":
    sys.stdout.write(page())
