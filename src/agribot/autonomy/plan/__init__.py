"""Field to path, path to mission: where to drive, and how far the work has come."""
