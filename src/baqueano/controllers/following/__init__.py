"""Compute the errors of a vehicle behind its path, and the response of its model, for a model follower."""
