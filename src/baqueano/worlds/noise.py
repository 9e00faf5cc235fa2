"""Draw noise as an input of a simulation: one stream of standard normals per name, all from one seed.

The key of a stream is the hash of its name, so an added or removed sensor does not change the noise of others.
"""

import numpy as np

from baqueano.errors import UsageError

PROCESS_STREAM = "process"  # the vehicle's own stream


def sensor_stream(name: str) -> str:
    """Return the name of the stream of the sensor `name`."""
    return f"sensor.{name}"


def random_stream(seed: int, name: str) -> "np.random.Generator":
    """Return the random generator that belongs to `name` under `seed`. Raise UsageError for an invalid seed."""
    import hashlib  # imported here because it loads OpenSSL, and a robot does not draw noise

    if not isinstance(seed, int | np.integer) or seed < 0:
        raise UsageError.of("drive.seed", value=repr(seed))
    key = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, key])))


def unit_normals(seed: int, name: str, tick_count: int, size: int) -> np.ndarray:
    """Return standard normals (ticks, size); the first rows do not depend on the number of ticks."""
    return random_stream(seed, name).standard_normal((tick_count, size))
