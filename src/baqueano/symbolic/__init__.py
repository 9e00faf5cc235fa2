"""The engine room: a plain NumPy function → graph → derivatives → C or Python. It knows no vehicle.

`scan` owns a loop over time, `function` and `compiled` make one call fast, `jacobian` derives. The functions
given to them are ordinary NumPy text: pure, with no `if` on a value that is known only at run time.
"""

from baqueano.symbolic.array import interp, where
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
