"""Many runs of one mission: other seeds, other settings, one table."""
