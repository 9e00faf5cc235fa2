"""Left and right: what two wheels tell of the turning, against the gyro or the truth.

    right − left = track · ω                                                                              (1)

The track is that of no map, so only its sign and its size are judged: between 3 cm and 5 m. A gyro that turns against
the wheels is inverted where a_y = v ω contradicts it too; else wheels that are swapped and an IMU that hangs upside
down (a_y and gyro inverted) look alike, and both are named.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from baqueano.runs.diagnostics.correlation import CLEAR, ENOUGH, NONE, relation
from baqueano.runs.diagnostics.doubt import Doubt

if TYPE_CHECKING:
    from baqueano.runs.maps.columns import Entry

NARROWEST_M, WIDEST_M = (
    0.03,
    5.0,
)  # tracks of the vehicles that baqueano is for; one that skids seems twice as wide
TURNED_RAD_S = 0.1  # standard deviation of a drive that turned


def sides(
    wheels: str, apart: np.ndarray, rate: np.ndarray, imu: "Sequence[Entry] | None", felt: float
) -> list[Doubt]:
    """Doubts by the means of right − left (W,) and of ω (W,), told by the gyro of an `imu` (a_x, a_y, ω), or by the
    truth where that is None; `felt` is the correlation of a_y with v ω, 0 where it is not known."""
    if len(rate) < ENOUGH or not np.isfinite(apart + rate).all() or not np.std(rate) > TURNED_RAD_S:
        return []
    by = imu[2].key if imu else "[truth]"
    track, r = relation(rate, apart)
    if r < -CLEAR:
        return [_opposed(f"{by} turns against {wheels} (correlation {r:.2f})", wheels, imu, felt)]
    if r > CLEAR and not NARROWEST_M < track < WIDEST_M:
        text = f"{wheels} and {by} turn as wheels that are {track:.3g} m apart do (correlation {r:.2f})"
        cure = f"check the scale of both: counts_per_turn, radius_m, unit of {wheels}, unit of {by}"
        return [Doubt("track", "error", None, text, cure)]
    if abs(r) < NONE and np.std(apart) > 0.0:
        text = f"{wheels} does not turn as {by} says (correlation {r:.2f})"
        return [Doubt("unrelated", "warning", None, text)]
    return []


def _opposed(said: str, wheels: str, imu: "Sequence[Entry] | None", felt: float) -> Doubt:
    """The one that is inverted, or those that may be."""
    swap = f"swap left and right of {wheels}"
    if imu is None:
        return Doubt("inverted", "error", None, said, swap)
    mend, also = (f"scale = {-entry.scale:g} for {entry.key}" for entry in (imu[2], imu[1]))
    if felt < -CLEAR:
        text = f"{said}, and {imu[1].key} against it ({felt:.2f})"
        return Doubt("inverted", "error", None, text, f"write {mend}")
    if felt > CLEAR:
        cure = f"{swap}, or if the IMU is upside down write {mend} and {also}"
    else:
        cure = f"{swap}, or if the gyro is negative where the vehicle turns left write {mend}"
    return Doubt("inverted", "error", None, said, cure)
