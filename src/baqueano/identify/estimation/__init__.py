"""The search for the least cost."""
