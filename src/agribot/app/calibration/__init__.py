"""Calibration of a robot by driving a figure, and the robot's own settings that result."""
