"""What speaks against a sensor: watches of fixes, headings, rows, pictures and wheels."""
