"""Noise of sensors and model: Q and R for the filter, and sensors at rest."""
