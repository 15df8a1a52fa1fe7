"""ROWS-10x12: navigation along crop rows on a fast parametric plant, one robot after another."""
