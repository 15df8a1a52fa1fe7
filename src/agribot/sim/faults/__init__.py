"""What goes wrong in the simulated world: one table of faults, and what each does."""
