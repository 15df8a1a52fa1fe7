"""The original's nodes: each hears topics, decides, and says topics; `agribot node` runs one."""
