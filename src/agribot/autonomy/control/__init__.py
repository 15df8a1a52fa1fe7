"""Path to wheel command, and the last gate before the motors."""
