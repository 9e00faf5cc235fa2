"""Noise comes in from outside: one stream of unit normals per name, all from one seed.

A stream is keyed by the hash of its name, so a sensor that is added or taken away changes nobody else's
noise.
"""

import hashlib

import numpy as np

PROCESS = "process"  # the name of the vehicle's own stream; sensors use theirs with "sensor." before it


def stream(seed: int, name: str) -> np.random.Generator:
    """The generator that belongs to `name` under `seed`."""
    key = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, key])))


def unit_normals(seed: int, name: str, ticks: int, size: int) -> np.ndarray:
    """(ticks, size) unit normals; the first rows do not depend on how many follow."""
    return stream(seed, name).standard_normal((ticks, size))
