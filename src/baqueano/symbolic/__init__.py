"""The engine room: a plain NumPy function → graph → derivatives → C or Python. It knows no vehicle.

`scan` owns a loop over time, `function` and `compiled` make one call fast, `jacobian` derives. The functions
given to them are ordinary NumPy text: pure, with no `if` on a value that is known only at run time.
"""

from typing import Any

import numpy as np

from baqueano.symbolic.dual import jacobian
from baqueano.symbolic.errors import TraceError
from baqueano.symbolic.function import compiled, function
from baqueano.symbolic.paths import get, put
from baqueano.symbolic.program import NormalEquations
from baqueano.symbolic.scan import Scan, scan

__all__ = [
    "NormalEquations",
    "Scan",
    "TraceError",
    "compiled",
    "function",
    "get",
    "interp",
    "jacobian",
    "put",
    "scan",
    "where",
]


def where(condition: Any, a: Any, b: Any) -> Any:
    """np.where, for whoever prefers a name of its own."""
    return np.where(condition, a, b)


def interp(x: Any, xp: Any, fp: Any) -> Any:
    """np.interp: piecewise linear in the table (xp, fp), held beyond its ends."""
    return np.interp(x, xp, fp)
