"""Logs of real robots through the robot's own filter: readers, mounting, the run, its figures."""
