"""Apply NumPy's elementwise functions to arrays of objects, by a call of `apply` for each element."""

from collections.abc import Callable
from operator import add, mul, neg, sub

import numpy as np

from baqueano.contracts.values import Value
from baqueano.symbolic.arrays.scalar import (
    ELEMENT_FUNCTIONS,
    apply,
    power,
    quotient,
    remainder,
    round_half_even,
    truth,
)


def elementwise(function: Callable[..., Value] | str, **identity: Value) -> np.ufunc:
    """Return a ufunc for arrays of objects, from a function of one or two elements or the name of an operator."""
    if isinstance(function, str):
        op = function
        function = (lambda a, b: apply(op, a, b)) if op in BINARY_OPERATORS else (lambda a: apply(op, a))
    ufunc = np.frompyfunc(function, function.__code__.co_argcount, 1, **identity)
    _FUNCTIONS[ufunc] = function
    return ufunc


_FUNCTIONS: dict[np.ufunc, Callable[..., Value]] = {}  # of one element, by the ufunc for arrays


def _finite(a: Value) -> Value:
    return apply("lt", apply("abs", a), np.inf)


def _ceil(a: Value) -> Value:
    return -apply("floor", -a)


def _copysign(a: Value, b: Value) -> Value:
    is_below = apply("or", apply("lt", b, 0.0), apply("lt", apply("div", 1.0, b), 0.0))  # 1/−0 is −∞
    return apply("abs", a) * apply("where", is_below, -1.0, 1.0)


def _trunc(a: Value) -> Value:
    return apply("sign", a) * apply("floor", apply("abs", a))


def _fmin(a: Value, b: Value) -> Value:
    return apply("where", apply("isnan", a), b, apply("where", apply("lt", b, a), b, a))


def _fmax(a: Value, b: Value) -> Value:
    return apply("where", apply("isnan", a), b, apply("where", apply("lt", a, b), b, a))


BINARY_OPERATORS = ("div", "min", "max", "atan2", "hypot", "lt", "le", "eq", "ne", "and", "or")
WHERE = np.frompyfunc(lambda c, a, b: apply("where", c, a, b), 3, 1)
TRACED_UFUNCS: dict[np.ufunc, np.ufunc] = {
    np.add: np.frompyfunc(add, 2, 1, identity=0),
    np.subtract: np.frompyfunc(sub, 2, 1),
    np.multiply: np.frompyfunc(mul, 2, 1, identity=1),
    np.negative: np.frompyfunc(neg, 1, 1),
    np.true_divide: elementwise("div"),
    np.power: elementwise(power),
    np.floor_divide: elementwise(quotient),
    np.remainder: elementwise(remainder),
    np.square: elementwise(lambda a: a * a),
    np.reciprocal: elementwise(lambda a: apply("div", 1.0, a)),
    np.positive: elementwise(lambda a: a),
    np.conjugate: elementwise(lambda a: a),
    np.absolute: elementwise("abs"),
    np.fabs: elementwise("abs"),
    np.sign: elementwise("sign"),
    np.sqrt: elementwise("sqrt"),
    np.exp: elementwise("exp"),
    np.log: elementwise("log"),
    np.log2: elementwise(lambda a: apply("log", a) * (1.0 / np.log(2.0))),
    np.log10: elementwise(lambda a: apply("log", a) * (1.0 / np.log(10.0))),
    np.sin: elementwise("sin"),
    np.cos: elementwise("cos"),
    np.tan: elementwise("tan"),
    np.arcsin: elementwise("asin"),
    np.arccos: elementwise("acos"),
    np.arctan: elementwise("atan"),
    np.arctan2: elementwise("atan2"),
    np.sinh: elementwise("sinh"),
    np.cosh: elementwise("cosh"),
    np.tanh: elementwise("tanh"),
    np.hypot: elementwise("hypot"),
    np.radians: elementwise(lambda a: a * (np.pi / 180.0)),
    np.deg2rad: elementwise(lambda a: a * (np.pi / 180.0)),
    np.degrees: elementwise(lambda a: a * (180.0 / np.pi)),
    np.rad2deg: elementwise(lambda a: a * (180.0 / np.pi)),
    np.floor: elementwise("floor"),
    np.ceil: elementwise(_ceil),
    np.trunc: elementwise(_trunc),
    np.rint: elementwise(round_half_even),
    np.minimum: elementwise("min", identity=None),
    np.maximum: elementwise("max", identity=None),
    np.fmin: elementwise(_fmin, identity=None),
    np.fmax: elementwise(_fmax, identity=None),
    np.copysign: elementwise(_copysign),
    np.less: elementwise("lt"),
    np.less_equal: elementwise("le"),
    np.greater: elementwise(lambda a, b: apply("lt", b, a)),
    np.greater_equal: elementwise(lambda a, b: apply("le", b, a)),
    np.equal: elementwise("eq"),
    np.not_equal: elementwise("ne"),
    np.logical_and: elementwise("and", identity=True),
    np.logical_or: elementwise("or", identity=False),
    np.logical_xor: elementwise(lambda a, b: apply("ne", apply("ne", a, 0.0), apply("ne", b, 0.0))),
    np.logical_not: elementwise("not"),
    np.bitwise_and: elementwise(lambda a, b: truth("and", a, b), identity=True),
    np.bitwise_or: elementwise(lambda a, b: truth("or", a, b), identity=False),
    np.bitwise_xor: elementwise(lambda a, b: truth("ne", a, b)),
    np.invert: elementwise(lambda a: truth("not", a)),
    np.isnan: elementwise("isnan"),
    np.isfinite: elementwise(_finite),
    np.isinf: elementwise(lambda a: apply("eq", apply("abs", a), np.inf)),
}
UFUNCS = {ufunc.__name__: operation for ufunc, operation in TRACED_UFUNCS.items()}
UFUNCS["real"] = UFUNCS["positive"]  # np.var uses it, in some versions as a ufunc
ELEMENT_FUNCTIONS |= {np.add: add, np.subtract: sub, np.multiply: mul, np.negative: neg}
ELEMENT_FUNCTIONS |= {ufunc: _FUNCTIONS[f] for ufunc, f in TRACED_UFUNCS.items() if f in _FUNCTIONS}
