"""Information on a term beside the other parameters of a model."""

import numpy as np

from baqueano.diagnostics import Diagnostic, note
from baqueano.identify.covariance.quantiles import QUANTILE_95
from baqueano.identify.selection.terms import BATTERY, Term


def own_information(A: np.ndarray, at: np.ndarray, others: np.ndarray) -> float:
    """The least part of the information on the entries `at` that none of the `others` could take."""
    if not np.all(np.diagonal(A)[at] > 0.0):
        return 0.0
    both = np.concatenate([at, others])
    root = np.sqrt(np.diagonal(A)[both])
    C = A[np.ix_(both, both)] / np.outer(root, root)
    n = len(at)
    values, vectors = np.linalg.eigh(C[n:, n:])
    seen = values > 1e-12 * max(float(values[-1]), 1e-300) if len(values) else np.zeros(0, bool)
    gain = C[:n, n:] @ vectors[:, seen]
    own = C[:n, :n] - (gain / values[seen]) @ gain.T
    return float(np.linalg.eigvalsh(own)[0])


def own_sd(A: np.ndarray, at: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(q,) standard errors of the entries `at` of θ by the information A (p, p) on those that are `free` (p,)."""
    used = np.flatnonzero((free | np.isin(np.arange(len(free)), at)) & (np.diagonal(A) > 0.0))
    root = np.sqrt(np.diagonal(A)[used])
    inverse = np.linalg.pinv(A[np.ix_(used, used)] / np.outer(root, root), hermitian=True)
    sd = np.full(len(free), np.inf)
    sd[used] = np.sqrt(np.maximum(np.diagonal(inverse), 0.0)) / root
    return np.asarray(sd[at])


def not_separated(term: Term, x: np.ndarray, sd: np.ndarray) -> Diagnostic | None:
    """Return why the runs do not tell the battery's effect from the rest; None where they do: κ is in 0 to 1."""
    half = QUANTILE_95 * float(sd[0])
    if term.paths != (BATTERY,) or (2.0 * half <= 1.0 and -half <= x[0] <= 1.0 + half):
        return None
    return note("term.battery-not-separable", value=x[0], half=half)
