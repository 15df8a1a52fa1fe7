"""Weed maps and prescriptions in the files of farm software, streamed in both directions."""
