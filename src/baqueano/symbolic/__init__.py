"""The engine room: a plain NumPy function → graph → derivatives → C or Python. It knows no vehicle.

`scan` owns a loop over time, `function` and `compiled` make one call fast, `jacobian` derives. The functions
given to them are ordinary NumPy text: pure, with no `if` on a value that is known only at run time.

A call goes through the house from the top down; each room knows only those below it:

    function, scan     what is called; plain runs the step as it is written, batch many at once, packing and paths
                       carry trees to rows and back
    backends           which of the two: c_code/ or python_code/
    derivatives/       the rule of each operator, dual numbers, tangents of a program
    graph/             trace → node → simplify → assemble → program → emit (the order of the arithmetic)
    arrays/            scalars and arrays that stand for numbers while a function is traced
    ieee, errors       arithmetic that never raises; errors that point at the user's line
"""

from baqueano.symbolic.arrays.array import interp, where
from baqueano.symbolic.derivatives.dual import jacobian
from baqueano.symbolic.errors import TraceError
from baqueano.symbolic.function import compiled, function
from baqueano.symbolic.graph.program import NormalEquations
from baqueano.symbolic.paths import get, put
from baqueano.symbolic.scan import Scan, scan

__all__ = ["Scan", "TraceError", "compiled", "function", "interp", "jacobian", "scan", "where"]
