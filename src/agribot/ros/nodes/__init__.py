"""The original's nodes, each between some topics and others; `agribot node` runs one."""
