"""Compute linear algebra of small matrices of scalars: products and triangular factors, which exploit symmetry.

A product stores its factors. A P Aᵀ with P symmetric is symmetric: only one triangle is computed, and the other has the
same scalars. With A = I − K H the product A B is B − K (H B), which needs fewer operations. The user does not need to
declare a symmetry: two entries are equal if they are the same node.
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.symbolic.arrays.scalar import Scalar, apply
from baqueano.symbolic.errors import trace_error


class Origin(NamedTuple):
    """The factors from which a matrix was computed: left @ right, or I − left @ right."""

    left: np.ndarray
    right: np.ndarray
    is_complement: bool
    cells: np.ndarray  # a copy of the result, to detect later changes of it

    def transpose(self) -> "Origin":
        """Return the origin of the transposed matrix."""
        return Origin(self.right.T, self.left.T, self.is_complement, self.cells.T)


def matmul(a: Value, b: Value) -> Value:
    """Return a @ b for vectors and matrices; if one is a plain number, the product a b, as np.dot does.

    Raise TraceError if the shapes do not agree.
    """
    from baqueano.symbolic.arrays.array import as_array, as_traced

    x, y = as_array(a), as_array(b)
    if x.ndim == 0 or y.ndim == 0:
        return a * b
    if x.ndim > 2 or y.ndim > 2:
        return as_traced(np.matmul(x, y))
    if x.shape[-1] != y.shape[0]:
        raise trace_error("trace.product-shapes", left=str(x.shape), right=str(y.shape))
    rows, columns = np.atleast_2d(x), y if y.ndim == 2 else y[:, None]
    product = _product(rows, columns, array_origin(a), array_origin(b))
    result = as_traced(product.reshape(x.shape[:-1] + y.shape[1:]))
    if x.ndim == y.ndim == 2:
        result.origin = Origin(rows.copy(), columns.copy(), False, product.copy())
    return result


def dot(a: Value, b: Value) -> Value:
    """Return np.dot(a, b), which differs from a @ b only for arrays of more than two axes."""
    from baqueano.symbolic.arrays.array import as_array, as_traced

    x, y = as_array(a), as_array(b)
    return matmul(a, b) if max(x.ndim, y.ndim) < 3 else as_traced(np.dot(x, y))


def array_origin(x: Value) -> Origin | None:
    """Return the origin of an array; None if it is unknown, or if the array was changed since then."""
    origin = getattr(x, "origin", None)
    return origin if origin is not None and are_same_arrays(origin.cells, x) else None


def store_complement(result: Value, a: Value, b: Value) -> None:
    """Store the origin of `result` = a − b in it, if it is I − K H."""
    origin = array_origin(b)
    if origin is None or origin.is_complement or not isinstance(a, np.ndarray) or a.shape != b.shape:
        return
    if len(a) == a.shape[1] > origin.left.shape[1] and are_same_arrays(a, np.eye(len(a))):
        result.origin = Origin(origin.left, origin.right, True, result.view(np.ndarray).copy())


def are_same_arrays(a: np.ndarray, b: np.ndarray) -> bool:
    """Return True if the shapes are equal and each entry is the same scalar or number."""
    return a.shape == b.shape and all(map(_identical, a.ravel().tolist(), b.ravel().tolist()))


def is_symmetric(a: np.ndarray) -> bool:
    """Return True for a square matrix whose mirrored entries are the same scalars."""
    return a.ndim == 2 and len(a) == a.shape[1] and are_same_arrays(a, a.T)


def _identical(x: Value, y: Value) -> bool:
    return x is y or (not isinstance(x, Scalar) and not isinstance(y, Scalar) and bool(x == y))


def _product(a: np.ndarray, b: np.ndarray, origin_a: Origin | None, origin_b: Origin | None) -> np.ndarray:
    n, m = a.shape[0], b.shape[1]
    minuend: np.ndarray | None = None
    if origin_b is not None and origin_b.is_complement:  # a (I − L R) = a − (a L) R
        minuend, a, b = a, _product(a, origin_b.left, None, None), origin_b.right
    elif origin_a is not None and origin_a.is_complement:  # (I − L R) b = b − L (R b)
        minuend, a, b = b, origin_a.left, _product(origin_a.right, b, None, None)
    has_mirror = (
        origin_a is not None
        and not origin_a.is_complement
        and _is_congruence(origin_a, b if minuend is None else origin_b)
    )
    rows, columns = [_terms(row) for row in a.tolist()], b.T.tolist()
    product = np.empty((n, m), dtype=object)
    for i in range(n):
        for j in range(i if has_mirror else 0, m):
            dot = _dot(rows[i], columns[j])
            product[i, j] = dot if minuend is None else minuend[i, j] - dot
            if has_mirror:
                product[j, i] = product[i, j]
    return product


def _is_congruence(origin_a: Origin, b: Value) -> bool:
    """Return True if a @ b is L P Lᵀ: a = L P with P symmetric, and b = Lᵀ."""
    return are_same_arrays(origin_a.left, (b.cells if isinstance(b, Origin) else b).T) and is_symmetric(
        origin_a.right
    )


def _terms(row: list[Value]) -> list[tuple[int, Value]]:
    """Return the entries that are not 0, with their places."""
    return [(k, x) for k, x in enumerate(row) if not _is_zero(x)]


def _dot(row: list[tuple[int, Value]], column: list[Value]) -> Value:
    total: Value = 0.0
    for k, x in row:
        y = column[k]
        if not _is_zero(y):
            total = total + x * y
    return total


def _is_zero(x: Value) -> bool:
    return x == 0.0 if type(x) is float else not isinstance(x, Scalar) and x == 0.0


def solve(a: Value, b: Value) -> Value:
    """Return x with a x = b, b (n,) or (n, m): by L D Lᵀ if a is symmetric, else by L U with exchanges of rows.

    A symmetric matrix must be definite. Raise TraceError for shapes that do not agree, or for a singular matrix.
    """
    from baqueano.symbolic.arrays.array import as_array, as_traced

    A, x = as_array(a).copy(), as_array(b).copy()
    if A.ndim != 2 or A.shape[0] != A.shape[1] or x.ndim not in (1, 2) or len(x) != len(A):
        raise trace_error("trace.solve-shapes", left=str(A.shape), right=str(x.shape))
    return as_traced(_solve(A, x if x.ndim == 2 else x[:, None]).reshape(x.shape))


def inv(a: Value) -> Value:
    """Return the inverse (n, n) of a square matrix."""
    return solve(a, np.eye(len(a)))


def det(a: Value) -> Value:
    """Return the determinant: the product of the pivots, with a change of sign for each exchange of rows."""
    from baqueano.symbolic.arrays.array import as_array

    A = as_array(a).copy()
    result: Value = 1.0
    for k in range(len(A)):
        result = result * _exchange_rows(A, np.empty((len(A), 0), dtype=object), k) * A[k, k]
        _eliminate(A, k, is_symmetric(A[k:, k:]))
    return result


def norm(x: Value, ord: Value = None, axis: Value = None, keepdims: bool = False) -> Value:
    """Return the Euclidean norm over `axis`, √ of the sum of squares. Raise TraceError for another norm."""
    if ord not in (None, 2, "fro") or (ord == 2 and np.ndim(x) == 2 and axis is None):
        raise trace_error("trace.norm")
    return np.sqrt(np.sum(x * x, axis=axis, keepdims=keepdims))


def _solve(A: np.ndarray, x: np.ndarray) -> np.ndarray:
    n = len(A)
    for k in range(n):
        _exchange_rows(A, x, k)
        factors = _eliminate(A, k, is_symmetric(A[k:, k:]))
        for i, factor in factors.items():
            x[i] = [y - factor * z for y, z in zip(x[i].tolist(), x[k].tolist(), strict=True)]
    for k in reversed(range(n)):
        inverse = apply("div", 1.0, A[k, k])
        for j in range(x.shape[1]):
            x[k, j] = (x[k, j] - _dot(_terms(A[k, k + 1 :].tolist()), x[k + 1 :, j].tolist())) * inverse
    return x


def _exchange_rows(A: np.ndarray, x: np.ndarray, k: int) -> Value:
    """Move the largest entry of the column to row k of A and x, and return the sign of the exchanges.

    Scalars are compared at run time. A symmetric matrix stays unchanged. Raise TraceError if the column is zero.
    """
    if is_symmetric(A[k:, k:]) and not _is_zero(A[k, k]):
        return 1.0
    sizes = [np.finfo(float).tiny if isinstance(a, Scalar) else abs(a) for a in A[k:, k].tolist()]
    first = k + int(np.argmax(sizes))  # a known number before a scalar, a scalar before 0
    if _is_zero(A[first, k]):
        raise trace_error("trace.singular", column=k)
    sign: Value = 1.0 if first == k else -1.0
    for M in (A, x):
        M[[k, first]] = M[[first, k]]
    for i in range(k + 1, len(A)):
        if not _is_zero(A[i, k]):
            is_larger = apply("lt", apply("abs", A[k, k]), apply("abs", A[i, k]))
            for M in (A[:, k:], x):
                pairs = list(zip(M[k].tolist(), M[i].tolist(), strict=True))
                M[k] = [apply("where", is_larger, lower, upper) for upper, lower in pairs]
                M[i] = [apply("where", is_larger, upper, lower) for upper, lower in pairs]
            sign = apply("where", is_larger, -sign, sign)
    return sign


def _eliminate(A: np.ndarray, k: int, is_symmetric_matrix: bool) -> dict[int, Value]:
    """Make column k zero below the diagonal, and return the factor of each row; a symmetric matrix stays symmetric."""
    inverse = apply("div", 1.0, A[k, k])
    factors = {i: A[i, k] * inverse for i in range(k + 1, len(A)) if not _is_zero(A[i, k])}
    for i, factor in factors.items():
        for j in range(i if is_symmetric_matrix else k + 1, len(A)):
            A[i, j] = A[i, j] - factor * A[k, j]
            if is_symmetric_matrix:
                A[j, i] = A[i, j]
        A[i, k] = 0.0
    return factors
