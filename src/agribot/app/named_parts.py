"""Which parts of the robot a reason names: those that it speaks of, in the parts of faults.

A reason is `<part>: <fact>; <action>` or a clause whose subject is the part. What it compares the
subject with ("against", "while", "though", "instead of") is not named, nor what advice says.
"""

from __future__ import annotations

import re

from agribot.sim.faults.table import Part

# Who says it, in front of what is said.
_SAID_BY = re.compile(
    r"^(?:\w+(?: by hand)? -> \w+(?: by hand)?|paused|failed|running|waiting|waiting for position"
    r"|no position(?: for [\d.]+ s)?|position lost|motor board|RUNAWAY)(?:: |, | \()"
)
_COMPARISON = re.compile(
    r"[:;?(]| (?:against|while|though|instead of|that neither|than|>|to the|knows of)\b"
)
_WORDS: dict[Part, str] = {
    "gnss": r"gnss|receiver",
    "compass": r"compass|magnet|heading",
    "imu": r"imu|gyro",
    "wheels": r"wheels?\b(?! slip)|encoder",
    "motors": r"motors?\b(?! board)|it hung",
    "ground": r"slip|stuck",
    "camera": r"camera|picture",
    "network": r"network",
    "bumper": r"bumper",
    "button": r"red button",
    "contactor": r"contactor",
    "battery": r"battery",
    "clock": r"clock",
    "link": r"link\b",
    "disk": r"recording|disk\b",
    "start": r"marked (?:start|at the start)|as marked|which row",
    "robot": r"tilted|carried|the robot moved",
    "crop": r"crop\b|gap\b",
    "inputs": r"not reported",
    "program": r"program\b",
}
_NAMES = {part: re.compile(rf"\b(?:{words})", re.IGNORECASE) for part, words in _WORDS.items()}


def read_parts(reason: str) -> frozenset[Part]:
    """Read the parts that a reason names; two where it leaves open which of them it is."""
    said = reason
    while (stripped := _SAID_BY.sub("", said)) != said:
        said = stripped
    subjects = [_COMPARISON.split(each)[0] for each in said.split(";")[0].split(", or ")]
    return frozenset(
        part for part, names in _NAMES.items() if any(names.search(subject) for subject in subjects)
    )
