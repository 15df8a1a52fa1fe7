"""Rows that nobody mapped: found by the camera, driven by its sight alone, and drawn."""
