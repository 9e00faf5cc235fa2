"""Compile plain NumPy functions: a function → its graph → derivatives → C or Python. It is independent of vehicles.

`scan` runs a step over time, `function` and `compile_block` make one call fast, `jacobian` differentiates. The
functions that they receive are ordinary NumPy code: pure, without `if` on a value that is known only at run time.

A call passes through the modules from top to bottom; each module imports only modules below it:

    function, traced    the calls of the user; plain runs the step of a scan unchanged, batch many at once, packing and
                        paths convert trees to rows and back
    backends            the choice: c_code/ or python_code/
    derivatives/        the rule of each operator, dual numbers, tangents of a program
    graph/              trace → node → simplify → assemble → program → emit (the order of the arithmetic)
    arrays/             scalars and arrays instead of numbers while a function is traced
    ieee, errors        arithmetic that never raises; errors that name the line of the user's code
"""

from baqueano.symbolic.arrays.array import interp, where
from baqueano.symbolic.branch import branch, tree_where
from baqueano.symbolic.derivatives.dual import chain_rule, jacobian
from baqueano.symbolic.errors import TraceError
from baqueano.symbolic.function import compile_block, function
from baqueano.symbolic.graph.program import NormalEquations
from baqueano.symbolic.paths import value_at_path, with_value, with_values
from baqueano.symbolic.scan import Scan
from baqueano.symbolic.traced import scan

__all__ = [
    "Scan",
    "TraceError",
    "branch",
    "compile_block",
    "function",
    "interp",
    "jacobian",
    "scan",
    "tree_where",
    "where",
]
