"""Commands for recordings, logs, photographs and networks."""
