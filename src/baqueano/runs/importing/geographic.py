"""Convert latitude and longitude into metres for the draft of a map: the plane that touches the ellipsoid at the start.

    x = N cos φ₀ (λ − λ₀),   y = M (φ − φ₀)      east and north of the first position                    (1)
    N = a/√(1 − e² sin² φ₀),   M = a (1 − e²)/(1 − e² sin² φ₀)^(3/2)                                     (2)

φ is the latitude, λ the longitude. Source of (2): WGS 84, NIMA TR8350.2. Within 1 km of the start and below 45° of
latitude, (1) is wrong by less than 0.2 m.
"""

from math import cos, radians, sin, sqrt

import numpy as np

EQUATOR_M, ECCENTRICITY2 = 6378137.0, 6.69437999014e-3
PER_DEGREE = (1.0, 1e7)  # degrees, and integers of receivers


def east_north_entries(longitude: np.ndarray, latitude: np.ndarray) -> tuple[tuple[float, float], ...]:
    """Return scale and offset of x from a column of longitudes, and of y from a column of latitudes; () if they are not
    degrees. A position of exactly 0, 0 is not yet known.

    >>> [(round(scale), offset) for scale, offset in east_north_entries(np.array([0.0, 1e-5]), np.array([0.0, 0.0]))]
    [(111319, -1.1131949079327357), (110574, -0.0)]
    """
    has_position = np.isfinite(longitude) & np.isfinite(latitude) & ((longitude != 0.0) | (latitude != 0.0))
    if not has_position.any():
        return ()
    lon, lat = longitude[has_position], latitude[has_position]
    per_degree = next(
        (k for k in PER_DEGREE if np.max(np.abs(lat)) <= 90.0 * k and np.max(np.abs(lon)) <= 180.0 * k), 0.0
    )
    if not per_degree:
        return ()
    phi = radians(float(lat[0]) / per_degree)
    w = 1.0 - ECCENTRICITY2 * sin(phi) ** 2
    east, north = EQUATOR_M / sqrt(w) * cos(phi), EQUATOR_M * (1.0 - ECCENTRICITY2) / w**1.5
    scales = (radians(east) / per_degree, radians(north) / per_degree)
    return tuple(
        (scale, -scale * float(first)) for scale, first in zip(scales, (lon[0], lat[0]), strict=True)
    )
