"""The tool that a robot carries: what it is, and what a new kind of it has to bring along."""
