"""Recordings that others made, each a module with rows(say, backend): what was found, and the bar it is held to."""
