"""The pose filter and the follower for many robots at once: the robot's own formulas and rules.

Robots are the last axis of every array.
"""
