"""What a log gave as poses: numbers, files, figures and the page."""
