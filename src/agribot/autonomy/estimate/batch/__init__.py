"""The pose filter for many robots at once: same formulas and rules, robots on the last axis."""
