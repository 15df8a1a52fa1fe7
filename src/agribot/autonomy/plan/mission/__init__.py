"""The mission: its states, jobs, errands, requests, and what it saves."""
