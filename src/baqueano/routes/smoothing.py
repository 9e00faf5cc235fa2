"""Smooth a driven path: remove the waves below a length, within a tolerance.

    p(s) = Σ p̂_k e^{iω_k s}   of a closed path; an open one is continued by reflection at its ends         (1)
    p̂_k ← p̂_k / (1 + (ω_k/ω_c)⁶)      the minimum of  ∫ |p − p_taught|² + ω_c⁻⁶ |p‴|² ds                  (2)
    κ = (p′_x p″_y − p′_y p″_x) / |p′|³                                                                  (3)

p is the position, s the distance along the path, p̂_k and ω_k amplitude and frequency of a wave, κ the curvature. The
cut-off ω_c is the smallest one within the tolerance, at least 2π/MAX_WAVE_M: longer curves keep their position, and a
drawn shape almost does not change. Stops, and turns on the spot, are excluded. (2) is the smoothing spline of
Schoenberg, Proceedings of the National Academy of Sciences, 1964, on evenly spaced points.
"""

from typing import Literal, NamedTuple

import numpy as np

from baqueano.contracts.calls import checked_call
from baqueano.errors import UsageError
from baqueano.guides.route import Route
from baqueano.routes.edit import has_close_ends
from baqueano.routes.path import (
    GRID_M,
    RoutePath,
    direction,
    distances_along,
    moving_indices,
    route_along,
    route_path,
)

MIN_TOLERANCE_M, MAX_TOLERANCE_M = 1e-4, 0.5  # range of a tolerance
MAX_WAVE_M = 0.8  # the longest wave that is removed
MIN_SPEED_SHARE = 0.2  # smallest speed, instead of a stop, as a share of the median speed
HALVING_COUNT = 30
MAX_PASSES, MIN_LENGTH_SHARE = 5, 0.9  # noise lengthens a path: then s is the distance along the smooth path


class Spectrum(NamedTuple):
    """A path as a Fourier series along its length, with its points and the straight line that was subtracted."""

    p: np.ndarray  # (n,) positions x + iy [m] at even distances, minus the straight part
    line: np.ndarray  # (n,) the straight line from the first to the last point
    omega: np.ndarray  # (n,) [rad/m]
    transform: np.ndarray  # (n,) Fourier transform of p
    points: int  # number of points of the path itself; the others are its reflection
    line_slope: complex  # derivative of the straight line along the path


@checked_call("bq.routes.smooth(route, 0.02)")
def smooth(route: Route, tolerance_m: float = 0.02, kind: Literal["rms", "max"] = "rms") -> Route:
    """Return a route on a smooth path near the taught one.

    Parameters
    ----------
    route : Route
        Driven only forward or only backward; it is not changed.
    tolerance_m : float [m]
        Largest allowed distance between the new path and the old one.
    kind : {"rms", "max"}
        The tolerance limits the root of the mean square, or the largest distance.

    Returns
    -------
    Route
        A route with a pose every centimetre; closed if the ends meet. The speed is the taught speed, without stops.

    Raises
    ------
    UsageError
        For a tolerance outside 0.1 mm to 0.5 m, or a route without speeds, or one that drives forward and backward.

    References
    ----------
    Schoenberg, Proceedings of the National Academy of Sciences, 1964.

    Examples
    --------
    >>> taught = bq.guides.shapes.rectangle(1.2, 0.8, 0.1, 0.2)
    >>> smooth(taught, 0.01, "max")
    Route(380 poses, 18.9 s, 3.79 m, closed)
    """
    if not MIN_TOLERANCE_M <= tolerance_m <= MAX_TOLERANCE_M:
        raise UsageError.of(
            "route.tolerance", value=tolerance_m, min_m=MIN_TOLERANCE_M, largest_m=MAX_TOLERANCE_M
        )
    forward_sign, indices = direction(route), moving_indices(route)
    speed = np.abs(route.nu[indices, 0])
    if not (median_speed := float(np.median(speed))) > 0.0:
        raise UsageError.of("route.speed", value=median_speed)
    is_closed = route.closed or has_close_ends(route)
    s = distances_along(route.eta[indices, :2])
    spectrum, cutoff_rad_m, s = _spectrum_and_cutoff(route.eta[indices, :2], s, is_closed, tolerance_m, kind)
    slip = np.broadcast_to(route_path(route).slip, s.shape)
    slip_spectrum = _spectrum(np.column_stack([slip, np.zeros(len(s))]), s, is_closed)
    path = _path(spectrum, slip_spectrum, cutoff_rad_m)
    speed = np.maximum(speed, MIN_SPEED_SHARE * median_speed)
    return route_along(path, np.interp(path.s / path.s[-1], s / s[-1], speed), forward_sign, closed=is_closed)


def _spectrum(xy: np.ndarray, s: np.ndarray, is_closed: bool) -> Spectrum:
    """Return the Fourier series of a path through points (m, 2) at the distances s (m,).  (1)"""
    n = max(8, round(s[-1] / GRID_M) + 1)
    grid = np.linspace(0.0, s[-1], n)
    p = np.interp(grid, s, xy[:, 0]) + 1j * np.interp(grid, s, xy[:, 1])
    line_slope = (p[-1] - p[0]) / s[-1]
    line = p[0] + line_slope * grid
    p = p - line  # 0 at both ends
    p = p[:-1] if is_closed else np.concatenate([p, -p[-2:0:-1]])
    omega = 2.0 * np.pi * np.fft.fftfreq(len(p), s[-1] / (n - 1))
    return Spectrum(p, line, omega, np.fft.fft(p), n, line_slope)


def _spectrum_and_cutoff(
    xy: np.ndarray, s: np.ndarray, is_closed: bool, tolerance_m: float, kind: str
) -> tuple[Spectrum, float, np.ndarray]:
    """Return the series, ω_c, and the distances (m,) of the points along the path; without noise these are `s`."""
    spectrum = _spectrum(xy, s, is_closed)
    cutoff_rad_m = _cutoff(spectrum, tolerance_m, kind)
    for _ in range(MAX_PASSES):
        smooth_s = _smooth_distances(spectrum, cutoff_rad_m, s)
        if smooth_s[-1] > MIN_LENGTH_SHARE * s[-1]:
            break
        s = smooth_s
        spectrum = _spectrum(xy, s, is_closed)
        cutoff_rad_m = _cutoff(spectrum, tolerance_m, kind)
    return spectrum, cutoff_rad_m, s


def _smooth_distances(spectrum: Spectrum, cutoff_rad_m: float, s: np.ndarray) -> np.ndarray:
    """Return the distances (m,) along the smooth path of the points at the distances s (m,)."""
    p = _low_pass(spectrum, cutoff_rad_m) + spectrum.line
    distance_m = distances_along(np.column_stack([np.real(p), np.imag(p)]))
    return np.interp(s, np.linspace(0.0, s[-1], spectrum.points), distance_m)


def _cutoff(spectrum: Spectrum, tolerance_m: float, norm: str) -> float:
    """Return ω_c [rad/m], the smallest cut-off within the tolerance, at least 2π/MAX_WAVE_M."""
    low, high = 2.0 * np.pi / MAX_WAVE_M, np.pi / GRID_M
    if _deviation(spectrum, low, norm) <= tolerance_m:
        return low
    for _ in range(HALVING_COUNT):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if _deviation(spectrum, middle, norm) <= tolerance_m else (middle, high)
    return high


def _low_pass(spectrum: Spectrum, cutoff_rad_m: float, order: int = 0) -> np.ndarray:
    """Return the low-passed path as complex numbers (points,), or its derivative of the given `order`.  (2)"""
    gain = (1j * spectrum.omega) ** order / (1.0 + (spectrum.omega / cutoff_rad_m) ** 6)
    p = np.fft.ifft(gain * spectrum.transform)
    return np.append(p, p[0])[: spectrum.points] if len(p) < spectrum.points else p[: spectrum.points]


def _deviation(spectrum: Spectrum, cutoff_rad_m: float, norm: str) -> float:
    """Return the distance [m] between smooth path and points: the largest one if `norm` is "max", else the rms."""
    taught_points = np.append(spectrum.p, spectrum.p[0])[: spectrum.points]
    distances = np.abs(_low_pass(spectrum, cutoff_rad_m) - taught_points)
    return float(np.max(distances) if norm == "max" else np.sqrt(np.mean(distances**2)))


def _path(spectrum: Spectrum, slip_spectrum: Spectrum, cutoff_rad_m: float) -> RoutePath:
    """Return the smooth path with one point every GRID_M, and at least eight points.  (3)"""
    p = _low_pass(spectrum, cutoff_rad_m) + spectrum.line
    p1, p2 = _low_pass(spectrum, cutoff_rad_m, 1) + spectrum.line_slope, _low_pass(spectrum, cutoff_rad_m, 2)
    kappa = np.imag(np.conj(p1) * p2) / np.maximum(np.abs(p1), 1e-9) ** 3
    x, y, slip = np.real(p), np.imag(p), np.real(_low_pass(slip_spectrum, cutoff_rad_m) + slip_spectrum.line)
    s = distances_along(np.column_stack([x, y]))
    course, kappa = np.unwrap(np.angle(p1)) - slip, kappa - np.gradient(slip, s)
    grid = np.linspace(0.0, s[-1], max(8, round(s[-1] / GRID_M) + 1))
    x, y, course, kappa, slip = (np.interp(grid, s, column) for column in (x, y, course, kappa, slip))
    return RoutePath(grid, np.column_stack([x, y]), course, kappa, slip)
