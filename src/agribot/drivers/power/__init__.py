"""Relays that switch the power of motors."""
