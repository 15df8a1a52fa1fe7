"""Commands that run a robot: the run, its page, bridges, nodes, teleoperation, replay."""
