"""Everything AGRIBOT raises on purpose, as one tree.

AgribotError
├── ConfigError         a setting is unknown, out of range or contradicts another
├── DescriptionError    a robot or world file cannot be understood
├── MissionError        a field, plan or waypoint list cannot be driven
├── PerceptionError     model weights are missing or do not fit the camera
├── RecordingError      a run cannot be written or read back
├── BridgeError         another program cannot be reached, or sends unreadable data
└── PlatformError       the robot or the simulator stopped answering
    └── EndOfRecording  a replay has no more batches: the normal end, not a fault

A message says what happened, the value, the limit and what to do about it.
"""


class AgribotError(Exception):
    """Base of all errors that a user can act on; the command line prints it without a traceback."""


class ConfigError(AgribotError):
    pass


class DescriptionError(AgribotError):
    pass


class MissionError(AgribotError):
    pass


class PerceptionError(AgribotError):
    pass


class RecordingError(AgribotError):
    pass


class BridgeError(AgribotError):
    pass


class PlatformError(AgribotError):
    pass


class EndOfRecording(PlatformError):
    pass


def add_advice(fact: str, advice: str) -> str:
    """Add what to do to a fact that does not say it yet."""
    return fact if ";" in fact else f"{fact}; {advice}"
