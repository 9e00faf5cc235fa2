"""Solve a quadratic program of fixed size repeatedly, with OSQP.

    min ½ zᵀ P z + qᵀ z,  lower ≤ rows z ≤ upper,    low ≤ A z ≤ high                                     (1)

P is dense; `rows`, `lower` and `upper` are the same at each call. Source: Stellato et al., Mathematical Programming
Computation, 2020.
"""

from math import isfinite
from typing import Any

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import fault
from baqueano.errors import UsageError

SOLVED_STATUS = (1, 2)  # status of OSQP: solved, and solved with less accuracy
NO_BOUND = 1e6
OSQP_SETTINGS = {
    "verbose": False, "eps_abs": 1e-4, "eps_rel": 1e-4, "max_iter": 400, "polishing": False, "check_termination": 10,
    "adaptive_rho_interval": 50,
}  # fmt: skip


class BoundedProgram:
    """The solver of (1), with a warm start from the previous call."""

    def __init__(self, rows: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:
        self._rows, self._lower, self._upper = rows, lower, upper
        self._solver: Any = None  # OSQP without its Python interface, from the first call on

    def solve(self, matrices: Tree, start: np.ndarray) -> np.ndarray | None:
        """Return the solution z, in the shape of `start`, for P, q, A, low and high in `matrices`; None if it fails."""
        P, q, A, low, high = matrices
        if self._solver is None:
            self._set_up(P, q, A, low, high)
        solver: Any = self._solver
        solver.update_data_vec(q, *(self._bounds(low, high) if len(low) else (None, None)))
        A_values = np.vstack([self._rows, A]).T.take(self._index_A) if len(low) else None
        solver.update_data_mat(P.take(self._index_P), None, A_values, None)
        solver.warm_start(start.ravel(), None)
        solver.solve()
        x = solver.solution.x
        is_solved = solver.info.status_val in SOLVED_STATUS and isfinite(x.dot(x))
        return np.reshape(x, start.shape) if is_solved else None

    def _set_up(self, P: np.ndarray, q: np.ndarray, A: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
        """Set up the OSQP problem, with matrices in column order: upper triangle of P, sparse `rows`, dense A."""
        from scipy.sparse import csc_matrix

        upper = np.triu(np.ones_like(P)) > 0.0
        pattern = np.vstack([self._rows != 0.0, np.ones_like(A, bool)])
        matrices = [csc_matrix(np.where(matrix, 1.0, 0.0)) for matrix in (upper, pattern)]
        self._index_P, self._index_A = (np.flatnonzero(matrix.T) for matrix in (upper, pattern))
        matrices[0].data = P.take(self._index_P)
        matrices[1].data = np.vstack([self._rows, A]).T.take(self._index_A)
        program = _osqp()
        program.setup(matrices[0], q, matrices[1], *self._bounds(low, high), **OSQP_SETTINGS)
        self._solver = program._solver

    def _bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        low, high = np.clip(low, -NO_BOUND, NO_BOUND), np.clip(high, -NO_BOUND, NO_BOUND)
        return np.concatenate([self._lower, low]), np.concatenate([self._upper, high])


def _osqp() -> Any:
    """Return a new OSQP solver; raise UsageError if OSQP is not installed."""
    try:
        import osqp
    except ImportError as error:
        raise UsageError(fault("mpc.no-solver", "pip install osqp")) from error
    return osqp.OSQP()
