"""What implements do to the simulated field, and the field to the robot."""
