"""Labels as other tools write them; every reader takes bytes and touches no file."""
