"""The robot's end of the page: the states of a run, and the requests to it."""
