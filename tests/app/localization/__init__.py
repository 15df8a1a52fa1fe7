"""Logs through the filter."""
