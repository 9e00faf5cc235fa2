"""The elementary functions of the package: an error of a few units in the last place, for one lane and for eight."""

import ctypes
import math

import numpy as np
import pytest

from baqueano.symbolic.c_code import compile
from baqueano.symbolic.c_code.c_text import header

pytestmark = pytest.mark.skipif(compile.find_compiler().compiler is None, reason="no C compiler")

WIDTHS = (1, 2, 8)
LOOP = """
EXPORT void {name}_of_{width}(const double *a, const double *b, double *y, int64_t n) {{
    for (int64_t i = 0; i < n; i += {width}) {{
        v_{width} x, z;
        __builtin_memcpy(&x, a + i, sizeof x);
        __builtin_memcpy(&z, b + i, sizeof z);
        x = {name}_{width}({arguments});
        __builtin_memcpy(y + i, &x, sizeof x);
    }}
}}
"""
ANY = ("abs", "sign", "floor")
ONE = (*ANY, "sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "sinh", "cosh", "tanh", "sqrt")
TWO = ("atan2", "hypot", "min", "max", "pow")
COUNT = 2048
SPECIAL = np.array([0.0, -0.0, 1.0, -1.0, math.inf, -math.inf, math.nan, 5e-324])


@pytest.fixture(scope="module")
def library() -> ctypes.CDLL:
    pairs = [(name, "x") for name in ONE] + [(name, "x, z") for name in TWO]
    body = "".join(LOOP.format(name=n, width=w, arguments=a) for n, a in pairs for w in WIDTHS)
    return compile.load_library((body,), lambda: (header(body, []) + body, 0))


def evaluate(library: ctypes.CDLL, name: str, width: int, a: np.ndarray, b: np.ndarray | None = None):
    y = np.empty_like(a)
    pointers = [ctypes.c_void_p(x.ctypes.data) for x in (a, a if b is None else b, y)]
    getattr(library, f"{name}_of_{width}")(*pointers, ctypes.c_int64(len(a)))
    return y


def oracle(name: str, *arguments: np.ndarray) -> np.ndarray:
    """Return the value of the C library through math, one at a time, or that of NumPy if math raises."""
    ufunc = {"min": np.minimum, "max": np.maximum, "asin": np.arcsin, "acos": np.arccos, "atan": np.arctan,
             "atan2": np.arctan2, "pow": np.power}.get(name) or getattr(np, name)  # fmt: skip
    exact = getattr(math, name, None)
    with np.errstate(all="ignore"):
        y = ufunc(*arguments)
    for i, values in enumerate(zip(*arguments, strict=True)):
        if exact is not None and np.isfinite(y[i]) and name not in ("pow", "floor"):
            y[i] = exact(*values)
    return y


def magnitudes(low: float, high: float, signs: bool = True) -> np.ndarray:
    draw = np.random.default_rng(0)
    x = np.exp(draw.uniform(math.log(low), math.log(high), COUNT))
    return x * draw.choice([-1.0, 1.0], COUNT) if signs else x


def uniform(low: float, high: float) -> np.ndarray:
    return np.random.default_rng(0).uniform(low, high, COUNT)


TURNS = [magnitudes(1e-300, 10.0), magnitudes(1.0, 1e6), np.arange(COUNT) * math.pi / 2 + 1e-9]
WIDE = [magnitudes(1e-310, 1e300), uniform(-3.0, 3.0)]
RANGES = {
    "sin": TURNS, "cos": TURNS, "tan": TURNS,
    "exp": [magnitudes(1e-300, 700.0), uniform(-745.1, -700.0), uniform(700.0, 709.7)],
    "log": [magnitudes(1e-320, 1e308, False), 1.0 + magnitudes(1e-16, 0.5), uniform(0.5, 2.0)],
    "tanh": [magnitudes(1e-310, 100.0), uniform(-1.0, 1.0)],
    "sinh": [magnitudes(1e-310, 710.0), uniform(-1.0, 1.0), uniform(20.0, 24.0)],
    "cosh": [magnitudes(1e-310, 710.0), uniform(-1.0, 1.0), uniform(20.0, 24.0)],
    "asin": [magnitudes(1e-300, 1.0), 1.0 - magnitudes(1e-16, 0.1, False)],
    "acos": [magnitudes(1e-300, 1.0), 1.0 - magnitudes(1e-16, 0.1, False)],
    "sqrt": [magnitudes(1e-310, 1e300, False)], "atan": WIDE, "abs": WIDE, "sign": WIDE,
    "floor": [uniform(-9.0, 9.0), magnitudes(1.0, 1e18)],
}  # fmt: skip


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", ONE)
def test_relative_error_is_a_few_units_in_the_last_place(library, name, width):
    for x in RANGES[name]:
        result, expected = evaluate(library, name, width, x), oracle(name, x)
        units = np.abs(result - expected) / np.spacing(np.abs(expected))
        assert units.max() <= 4.0, (name, x[units.argmax()])


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", TWO)
def test_error_of_two_argument_functions_is_a_few_units_in_last_place(library, name, width):
    draw = np.random.default_rng(1)
    for low, high in ((1e-150, 1e150), (1e-2, 1e2)):
        a = magnitudes(low, high, signs=name != "pow")
        b = draw.permutation(magnitudes(low, high)) if name != "pow" else draw.uniform(-2.0, 2.0, COUNT)
        result, expected = evaluate(library, name, width, a, b), oracle(name, a, b)
        assert np.all(np.abs(result - expected) <= 4.0 * np.spacing(np.abs(expected)))


def is_equal(result: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Return True if equal to 1e-15, including the sign of zero; NaN equals NaN."""
    with np.errstate(invalid="ignore"):
        y = (result == expected) | (np.abs(result - expected) <= 1e-15 * np.abs(expected))
    return (y & (np.signbit(result) == np.signbit(expected))) | (np.isnan(result) & np.isnan(expected))


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", ONE)
def test_zeros_infinities_and_nan_give_the_numpy_result(library, name, width):
    result, expected = evaluate(library, name, width, SPECIAL), oracle(name, SPECIAL)
    if name in ("sin", "tan"):
        result, expected = result + 0.0, expected + 0.0  # ours lose the sign of −0
    assert is_equal(result, expected).all(), (result, expected)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", TWO)
def test_pairs_of_zeros_infinities_and_nan_give_the_numpy_result(library, name, width):
    a, b = (np.ascontiguousarray(x.ravel()) for x in np.meshgrid(SPECIAL, SPECIAL))
    result, expected = evaluate(library, name, width, a, b), oracle(name, a, b)
    if name in ("min", "max"):
        # the order of two zeros is not defined
        result, expected = result + 0.0, expected + 0.0
    assert is_equal(result, expected).all(), list(zip(a, b, result, expected, strict=True))


@pytest.mark.parametrize("width", WIDTHS)
def test_overflow_is_infinite_and_underflow_is_gradual(library, width):
    x = np.array([709.8, 1000.0, -745.0, -746.0, -1e308, 1e308, -740.0, 710.4])
    with np.errstate(all="ignore"):
        np.testing.assert_allclose(evaluate(library, "exp", width, x), np.exp(x), rtol=1e-12)
        np.testing.assert_allclose(evaluate(library, "sinh", width, x), np.sinh(x), rtol=1e-12)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", ["sin", "cos"])
def test_large_angles_retain_full_precision(library, name, width):
    for limit in (1e9, 1e14, 1e300):
        x = magnitudes(1e6, limit)
        result, expected = evaluate(library, name, width, x), oracle(name, x)
        assert np.all(np.abs(result) <= 1.0 + 1e-12)
        assert np.all(np.abs(result - expected) <= 1e-15 * np.abs(x))
