"""Recordings, replay and the run report. Import the module that you need."""
