"""baqueano: identify, estimate, control and guide a small autonomous vehicle from its commands and IMU."""

__version__ = "0.1.0"
