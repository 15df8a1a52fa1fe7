"""Commands for robots, worlds, fields, plans and maps."""
