"""Solve a quadratic program of fixed size repeatedly, with OSQP.

    min ½ zᵀ P z + qᵀ z,  lower ≤ rows z ≤ upper,    low ≤ A z ≤ high                                     (1)

P is dense; `rows`, `lower` and `upper` are the same at each call. z has the unit of the plan (horizon.py). The scaling
of OSQP would depend on earlier calls: then a replay would compute other commands. Source: Stellato et al., Mathematical
Programming Computation, 2020.
"""

from functools import cached_property
from math import isfinite
from typing import Any

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.errors import UsageError

SOLVED_STATUS = (1, 2)  # status of OSQP: solved, and solved with less accuracy
NO_BOUND = 1e6
TINY = 1e-12
MIN_ROW_SHARE = 0.1  # of the largest coefficient of all rows
RHO = 2.0  # first step size of OSQP: between 1 and 3, a plan in these units needs the fewest iterations
OSQP_SETTINGS = {
    "verbose": False, "eps_abs": 1e-4, "eps_rel": 1e-4, "max_iter": 400, "polishing": False, "check_termination": 20,
    "adaptive_rho_interval": 50, "scaling": 0, "rho": RHO,
}  # fmt: skip


class BoundedProgram:
    """The solver of (1). A solution depends only on the matrices and the start, not on earlier calls."""

    def __init__(self, rows: np.ndarray, lower: np.ndarray, upper: np.ndarray, walls: int) -> None:
        self._wall_count, self._size = walls, rows.shape[1]
        self._rows, row_unit = _unit_rows(rows)
        self._lower, self._upper = lower / row_unit, upper / row_unit
        pattern = np.vstack([rows != 0.0, np.ones((walls, self._size), bool)])
        self._patterns = np.triu(np.ones((self._size, self._size))) > 0.0, pattern
        self._index_P, self._index_A = (np.flatnonzero(matrix.T) for matrix in self._patterns)

    @property
    def constraints(self) -> int:
        """Return the number of rows of both constraints of (1)."""
        return len(self._rows) + self._wall_count

    def solve(
        self, matrices: Tree, start: np.ndarray, multipliers: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the solution z, in the shape of `start`, and its multipliers (`constraints`,); None if it fails.

        P, q, A, low and high are in `matrices`.
        """
        P, q, A, low, high = matrices
        solver: Any = self._solver
        A_values, bounds = None, (None, None)
        if len(low):
            A, row_unit = _unit_rows(A)
            A_values, bounds = np.vstack([self._rows, A]), self._bounds(low / row_unit, high / row_unit)
            A_values = A_values.T.take(self._index_A)
        solver.update_data_mat(P.take(self._index_P), None, A_values, None)
        solver.update_data_vec(q, *bounds)
        solver.warm_start(start.ravel(), multipliers)
        solver.solve()
        info, solution = solver.info, solver.solution
        if info.iter >= OSQP_SETTINGS["adaptive_rho_interval"]:  # OSQP can have changed it
            solver.update_rho(RHO)
        x, y = solution.x, solution.y  # copies
        if info.status_val not in SOLVED_STATUS or not isfinite(x.dot(x) + y.dot(y)):
            return None
        return x.reshape(start.shape), y

    @cached_property
    def _solver(self) -> Any:
        """OSQP without its Python interface: upper triangle of P, sparse `rows`, dense A, in column order."""
        from scipy.sparse import csc_matrix

        P, A = (csc_matrix(np.where(matrix, 1.0, 0.0)) for matrix in self._patterns)
        walls = np.ones((self._wall_count, self._size))
        P.data = np.eye(self._size).take(self._index_P)
        A.data = np.vstack([self._rows, walls]).T.take(self._index_A)
        program, free = _osqp(), np.full(self._wall_count, np.inf)
        program.setup(P, np.zeros(self._size), A, *self._bounds(-free, free), **OSQP_SETTINGS)
        return program._solver

    def _bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        low, high = np.clip(low, -NO_BOUND, NO_BOUND), np.clip(high, -NO_BOUND, NO_BOUND)
        return np.concatenate([self._lower, low]), np.concatenate([self._upper, high])


def _unit_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (w, m) whose largest coefficient is 1, or smaller in rows without effect, and their units (w,)."""
    largest = np.max(np.abs(rows), axis=1)
    unit = np.maximum(largest, max(MIN_ROW_SHARE * float(np.max(largest)), TINY))
    return rows / unit[:, None], unit


def _osqp() -> Any:
    """Return a new OSQP solver; raise UsageError if OSQP is not installed."""
    try:
        import osqp
    except ImportError as error:
        raise UsageError.of("mpc.no-solver", "pip install osqp") from error
    return osqp.OSQP()
