"""The robot's end of the page: what a run shows, and what it is told."""
