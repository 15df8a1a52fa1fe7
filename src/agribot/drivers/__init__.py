"""Sensors that come from elsewhere than the platform, found by the scheme of their URI."""
