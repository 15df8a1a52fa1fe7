"""Curves, ways over rows and waypoints, and the ground that they must keep off."""
