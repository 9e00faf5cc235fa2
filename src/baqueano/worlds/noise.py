"""Noise comes in from outside: one stream of unit normals per name, all from one seed.

A stream is keyed by the hash of its name, so a sensor that is added or taken away changes nobody else's
noise.
"""

import numpy as np

PROCESS = "process"  # the vehicle's own stream


def sensor_stream(name: str) -> str:
    """The stream of the sensor `name`."""
    return f"sensor.{name}"


def stream(seed: int, name: str) -> "np.random.Generator":
    """The generator that belongs to `name` under `seed`."""
    import hashlib  # it loads OpenSSL, for which a robot does not wait: it draws nothing

    key = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, key])))


def unit_normals(seed: int, name: str, ticks: int, size: int) -> np.ndarray:
    """(ticks, size) unit normals; the first rows do not depend on how many follow."""
    return stream(seed, name).standard_normal((ticks, size))
