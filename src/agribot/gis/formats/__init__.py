"""Field files of other programs: each format read into, and written from, the same features."""
