"""Provide the studies.

Each is a command with a verdict: demo, the paper's cases, simulated vehicles, real recordings.
"""
