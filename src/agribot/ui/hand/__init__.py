"""Driving without a page: keys, mouse and gamepads, and the line to a running robot."""
