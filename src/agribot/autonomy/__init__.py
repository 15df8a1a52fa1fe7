"""Everything that the robot decides: where it is, what it sees, where to drive, what to treat."""
