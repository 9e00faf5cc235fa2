"""Generate forces that a model often lacks, as accelerations φ(t) along an axis, for unmodelled_terms.py.

w are the channels of the drivetrain (left and right wheel, or the commands), ν is the velocity of the model. Both are
relative to their largest value. φ is one of

    tanh 10 w    w |w|    |w|    w (t/T − ½)    sign w e^(−s/0.2 s), s since w changed its sign             (1)
    tanh 10 ν    ν |ν|    ν³     |ν|            sign ν e^(−s/0.2 s), s since ν changed its sign             (2)
    ν_x |ν_ψ|   ν_ψ²      ν_x |ν_x| ν_ψ²   ν_x ν_ψ (sideways)       along x                                (3)
    ν_ψ |ν_x|   ν_x ν_ψ   ν_ψ ν_x²         ν_ψ |ν_ψ| (sideways)     about ψ                                (4)

(1) are dead zones and backlash, motors that saturate or slip, motors that differ forward and backward, and a
discharging battery. (2) are dry and other friction, and a caster that flips; (3) and (4) are losses in corners. A
tyre that slips sideways in proportion to its force brakes with the square of the sideways acceleration, the third
term of (3). It also turns less than it is steered: the third term of (4).
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, note
from baqueano.identify.data.record import FitRecord

DECAY_S = 0.2  # duration of an effect that begins when a sign changes
SIGN_WIDTH = 0.1  # of the largest value: width of the tanh at a change of sign
COMMAND_TERMS = ("dead zone", "saturation", "asymmetry", "fading", "backlash")
MOTION_TERMS = (
    "dry friction",
    "drag",
    "steep drag",
    "one-sided drag",
    "caster",
    "cornering",
    "turning",
    "slip",
)
SIDEWAYS_TERMS = {0: note("term.sideways-slip"), 2: note("term.sideways-push")}


class Force(NamedTuple):
    """One force φ along one axis, and its channel for a force of (1)."""

    code: str
    description: Diagnostic
    axis: int
    channel: int | None = None


def force_terms(axis: int, channel_count: int) -> list[Force]:
    """Return the forces along `axis` (0 or 2) and then a sideways force.

    The order is that of `command_features` and `motion_features`.
    """
    command_forces = [
        Force(f"{code} of channel {j}", _term(code), axis, j)
        for code in COMMAND_TERMS
        for j in range(channel_count)
    ]
    motion_forces = [Force(code, _term(code), axis) for code in MOTION_TERMS]
    return [*command_forces, *motion_forces, Force("sideways", SIDEWAYS_TERMS[axis], 1)]


def _term(code: str) -> Diagnostic:
    return note(f"term.{code.replace(' ', '-')}")


def command_features(w: np.ndarray, record: FitRecord) -> np.ndarray:
    """Return φ (N, 5 c) of one segment with channels w (N, c), relative to their largest value.  (1)"""
    t, magnitude = np.cumsum(record.dt_s), np.abs(w)
    fading = w * (t / t[-1] - 0.5)[:, None]
    return np.concatenate(
        [np.tanh(w / SIGN_WIDTH), w * magnitude, magnitude, fading, _decay_since_sign_change(w, t)], axis=1
    )


def motion_features(axis: int, nu: np.ndarray, record: FitRecord) -> np.ndarray:
    """Return φ (N, 9) of one segment with motion ν (N, 3): (2), then (3) or (4)."""
    v = nu[:, axis : axis + 1] / max(float(np.max(np.abs(nu[:, axis]))), 1e-9)
    x, w, magnitude = nu[:, :1], nu[:, 2:], np.abs(v)
    along, about = (x * np.abs(w), w * w, x * np.abs(x) * w * w), (w * np.abs(x), x * w, w * x * x)
    corners = (*along, x * w) if axis == 0 else (*about, w * np.abs(w))
    flips = _decay_since_sign_change(v, np.cumsum(record.dt_s))
    return np.concatenate(
        [np.tanh(v / SIGN_WIDTH), v * magnitude, v * v * v, magnitude, flips, *corners], axis=1
    )


def driven_channels(model: Tree, u: np.ndarray) -> np.ndarray:
    """Return the channels (N, c) of the drivetrain for the commands u (N, n): the two wheels, or the commands."""
    drivetrain = getattr(model, "drivetrain", None)
    if getattr(drivetrain, "mixing", "none") == "two_wheels":
        return np.column_stack([u[:, 0] - u[:, 2], u[:, 0] + u[:, 2]])
    return u


def _decay_since_sign_change(x: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return sign x e^(−s/0.2 s) (N, c), where s is the time since the last change of sign; it is 0 before the first
    change.
    """
    decay = np.zeros_like(x)
    for c, sign in enumerate(np.sign(x).T):
        moving_rows = np.flatnonzero(sign != 0.0)
        reversals = (
            moving_rows[1:][sign[moving_rows[1:]] != sign[moving_rows[:-1]]]
            if len(moving_rows)
            else moving_rows
        )
        if len(reversals):
            edges = np.append(reversals, len(t))
            elapsed_s = t[reversals[0] :] - np.repeat(t[reversals], np.diff(edges))
            decay[reversals[0] :, c] = np.exp(-elapsed_s / DECAY_S) * sign[reversals[0] :]
    return decay
