"""Unmapped rows: found by the camera, driven by its sight alone, and drawn."""
