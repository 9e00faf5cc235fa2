"""A sensor whose clock is not the commands': what it showed at t happened at t + o.

The model's h is read from a line of the rows before (vehicles/delay.py), at the age of t + o. A measurement is read
CLOCK_S after its stamp, so that o may have either sign: from −CLOCK_S to CLOCK_S. o is found run by run; it belongs
to a recording, not to a vehicle.
"""

import numpy as np

CLOCK_S = 0.25  # the largest offset of a clock that a fit looks for


def slots_for(dt_s: np.ndarray) -> int:
    """Rows of the past that offsets of ± CLOCK_S need, with steps `dt_s` (N,)."""
    return int(np.ceil(2.0 * CLOCK_S / float(np.median(dt_s)))) + 2
