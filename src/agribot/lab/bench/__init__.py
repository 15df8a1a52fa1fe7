"""Benchmarks: what the parts of the robot can do, measured by one command each."""
