"""Coverage of a whole field: an area with holes, swaths, turns and their certificate."""
