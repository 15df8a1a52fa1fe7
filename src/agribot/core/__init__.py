"""The vocabulary: messages, settings, the robot, geometry. It needs numpy and msgspec only."""
