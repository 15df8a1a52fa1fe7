"""The page's server, a process of its own."""
