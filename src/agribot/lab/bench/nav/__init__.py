"""ROWS-10x12: navigation along crop rows on a fast parametric plant, hundreds of robots at once."""
