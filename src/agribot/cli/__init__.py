"""The commands of the `agribot` program, one module each: `add_arguments` and `run`."""
