"""Field files of other programs: each format is read into, and written from, features."""
