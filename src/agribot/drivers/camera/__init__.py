"""Cameras: devices, files, and network streams."""
