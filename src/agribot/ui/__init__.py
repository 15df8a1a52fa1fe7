"""The operator's page: its server, and the panels that a program may add to it from Python."""
