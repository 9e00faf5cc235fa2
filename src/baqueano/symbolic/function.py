"""Compile a function for fast calls: `function` for a function, `compile_block` for the step of a block.

The values of the arguments are written into one row of floats. The kernel of a scan of one tick fills another row,
which is read as the result. Types, None and text are part of the shape of an argument, and are checked.

The state of a filter contains many zeros, for states that are never correlated. If zeros of the first state stay zero
by induction, the kernel is simplified for them. Each call checks these zeros; if one is not 0, a general kernel runs.

The methods of blocks with equal parameters have the same code. Graphs and kernels of the latest blocks are cached.
"""

import inspect
import os
from collections.abc import Callable, Hashable
from dataclasses import fields, is_dataclass
from functools import cache
from threading import Lock
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.errors import Misuse
from baqueano.symbolic.backends import Runner, resolve_backend
from baqueano.symbolic.graph.assemble import assemble, remaining_zeros
from baqueano.symbolic.graph.program import Program
from baqueano.symbolic.graph.trace import is_stable, trace_function
from baqueano.symbolic.graph.tree import Shape, flat_row, tree_shape
from baqueano.symbolic.packing import ShapeMismatch, tree_function, updatable_state

MAX_CACHED = 24  # largest number of functions whose graph and kernel are cached


def function(f: Callable[..., Tree], *examples: Tree, backend: str = "auto") -> "Function":
    """Return `f`, compiled for arguments like the examples, with the same trees for arguments and result.

    Parameters
    ----------
    f : callable
        A pure function in NumPy, without `if` on values.
    *examples : tree
        One example per argument.
    backend : str
        "auto", "c", "python" or "numpy".

    Returns
    -------
    Function
        Callable like `f`. It raises Misuse for another number of arguments, and Invalid for an argument of another
        shape.

    Examples
    --------
    >>> speed = function(lambda nu: np.hypot(nu[0], nu[1]), np.zeros(3))
    >>> speed(np.array([3.0, 4.0, 0.0]))
    5.0
    """
    return Function(f, examples, backend)


def compile_block(block: Tree, backend: str = "auto") -> "CompiledBlock":
    """Return the block with a compiled `step`. Its fields are constants; its other attributes are unchanged.

    A block whose step contains a loop over time has the method `row`, the step of one input, which is compiled. It also
    has `rows_before(state, input)`, which returns the inputs before this input.

    Parameters
    ----------
    block : block
        A block with init() and step(...).
    backend : str
        "auto", "c", "python" or "numpy".

    Returns
    -------
    CompiledBlock
        Block with the same methods and attributes.

    Examples
    --------
    >>> law = compile_block(bq.controllers.Pd(alpha=4.0, beta=1.0))
    >>> law.alpha, law.init()
    (4.0, PdState(t_ns=-1, e_psi=0.0))
    """
    return CompiledBlock(block, backend)


class Function:
    """A function of trees of values, compiled at its creation."""

    def __init__(self, f: Callable[..., Tree], examples: tuple[Tree, ...], backend: str) -> None:
        self.f = f
        self._names = _argument_names(f, len(examples))
        self._shapes = [tree_shape(x, name) for x, name in zip(examples, self._names, strict=True)]
        backend = resolve_backend(backend)
        self.call = f  # the call without checks, for as many arguments as examples
        self._runner = None if backend == "numpy" else self._compile(backend, examples)
        self.backend = "numpy" if self._runner is None else self._runner.backend

    @property
    def source(self) -> str:
        """Return the generated code; "" with the back end "numpy"."""
        return "" if self._runner is None else self._runner.source

    def __call__(self, *args: Tree, **kwargs: Tree) -> Tree:
        """Return f(*args). Raise Misuse for another number of arguments, and Invalid for another shape."""
        if kwargs:
            args = inspect.signature(self.f).bind(*args, **kwargs).args
        if len(args) != len(self._shapes):
            raise Misuse.of(
                "engine.arguments", value=len(args), expected=len(self._shapes), names=self._names
            )
        return self.call(*args)

    def _compile(self, backend: str, examples: tuple[Tree, ...]) -> Runner:
        compiled_parts, empty_theta = _compile_parts(self.f, self._shapes, examples, backend), np.zeros(0)
        row, result = np.zeros((1, compiled_parts.inputs)), np.zeros((1, compiled_parts.outputs))

        def bind(runner: Runner) -> Callable[[], object]:
            return runner.call("bind", empty_theta, empty_theta, row, result, empty_theta)

        general = cache(lambda: bind(compiled_parts.general()))
        run = bind(compiled_parts.with_zero_states)
        self.call = tree_function(
            self._shapes, row[0], run, lambda: general()(), result[0], compiled_parts.shape
        )
        return compiled_parts.with_zero_states


class _CompiledParts(NamedTuple):
    """The compiled parts that are common to all functions of the same code."""

    with_zero_states: Runner  # for states that are 0 in the same entries as the example
    general: Callable[[], Runner]
    inputs: int
    outputs: int
    shape: Shape  # shape of the result


_cache: dict[Hashable, _CompiledParts] = {}  # the oldest first
_lock = Lock()


def _compile_parts(
    f: Callable[..., Tree], shapes: list[Shape], examples: tuple[Tree, ...], backend: str
) -> _CompiledParts:
    """Return the compiled parts from the cache, or compile them. So a second drive with equal blocks starts at once."""
    key = _key(f, shapes, examples, backend)
    compiled_parts = _cache.get(key) or _compile_new(f, shapes, examples, backend)
    if key is not None:
        with _lock:
            _cache.pop(key, None)
            _cache[key] = compiled_parts
            while len(_cache) > MAX_CACHED:
                del _cache[next(iter(_cache))]
    return compiled_parts


def _key(f: Callable[..., Tree], shapes: list[Shape], examples: tuple[Tree, ...], backend: str) -> Hashable:
    """Return a cache key, equal for equal code; None for a plain function, or a block whose code or data can change."""
    if not inspect.ismethod(f) or not shapes:
        return None
    try:
        zeros = flat_row(shapes[0], examples[0]) == 0.0
        key = (
            f.__func__,
            _parameter_key(f.__self__),
            tuple(shapes),
            zeros.tobytes(),
            backend,
            os.environ.get("BAQUEANO_CC"),
        )
        hash(key)
    except TypeError:
        return None
    return key


def _compile_new(
    f: Callable[..., Tree], shapes: list[Shape], examples: tuple[Tree, ...], backend: str
) -> _CompiledParts:
    trace = trace_function(f, shapes)
    full_program = assemble(trace, keep_all=True, given_start=True).program
    zero_runner = Runner(_simplified_for_zeros(full_program, shapes, trace.output_shape, examples), backend)
    general = cache(lambda: Runner(full_program, backend))
    return _CompiledParts(zero_runner, general, len(trace.inputs), len(trace.outputs), trace.output_shape)


def _parameter_key(x: object) -> Hashable:
    """Return a key, equal for equal parameters. Raise TypeError for a block with data outside its fields.

    Also raise it for a class of a notebook or an import: its step can use a global whose value the user changes.
    """
    if x is None or isinstance(x, str | int):
        return type(x), x
    if isinstance(x, float | np.number | np.ndarray) and (array := np.asarray(x)).dtype != object:
        return type(x), array.dtype.str, array.shape, array.tobytes()  # the bytes of 0 and −0 differ
    if isinstance(x, dict):
        return dict, tuple((key, _parameter_key(value)) for key, value in x.items())
    if isinstance(x, tuple | list):
        return type(x), tuple(map(_parameter_key, x))
    if not is_dataclass(x) or not is_stable(type(x)):
        raise TypeError(type(x))
    names = [field.name for field in fields(x)]
    if not set(names).issuperset(getattr(x, "__dict__", ())):
        raise TypeError(type(x))
    return type(x), tuple(_parameter_key(getattr(x, name)) for name in names)


class KernelKey:
    """Blocks and values as the key of a cache of kernels: equal to others with equal parameters and compiler.

    Blocks whose code or data can change are equal only to themselves.
    """

    def __init__(self, *parts: Tree) -> None:
        self.parts = parts  # also keeps them alive as long as the key
        self._key = _part_key(parts), os.environ.get("BAQUEANO_CC")

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, KernelKey) and self._key == other._key


def _part_key(x: Tree) -> Hashable:
    if isinstance(x, tuple):
        return type(x), tuple(map(_part_key, x))
    try:
        return _parameter_key(x)
    except TypeError:
        return id(x)


def _simplified_for_zeros(
    program: Program, shapes: list[Shape], shape: Shape, examples: tuple[Tree, ...]
) -> Program:
    """Return the program simplified for states that are 0 in the example and stay 0."""
    if updatable_state(shapes, shape) is None:
        return program
    zero = set(np.flatnonzero(flat_row(shapes[0], examples[0]) == 0.0).tolist())
    graph, inputs = program.graph, program.inputs
    zero = remaining_zeros(graph, inputs, program.outputs, zero)
    zero_node = graph.const(0.0)
    outputs = graph.substitute(program.outputs, {inputs[k]: zero_node for k in zero})
    outputs = [zero_node if k in zero else node for k, node in enumerate(outputs)]  # never −0
    return program._replace(outputs=tuple(outputs), zeros=tuple(inputs[k] for k in sorted(zero)))


class CompiledBlock:
    """A block whose step is compiled at its first call, for each shape of its arguments."""

    is_compiled: ClassVar[bool] = True

    def __init__(self, block: Tree, backend: str = "auto") -> None:
        self.block = block
        self.backend = resolve_backend(backend)
        self._requested_backend = self.backend
        self._steps: dict[tuple[Shape, ...], Function] = {}
        self._last: Callable[..., Tree] = _raise_never_called
        self._rows_before = getattr(block, "rows_before", None)
        self._text = block.step if self._rows_before is None else block.row

    def step(self, *args: Tree, **kwargs: Tree) -> Tree:
        """Return the result of the block's step, compiled for the shape of these arguments."""
        if kwargs:
            args = inspect.signature(self.block.step).bind(*args, **kwargs).args
        if self._rows_before is not None:
            for earlier_input in self._rows_before(*args):
                args = (self._row(args[0], earlier_input)[0], *args[1:])
        try:  # as in `_row`, without its call
            return self._last(*args)
        except (ShapeMismatch, TypeError):
            return self._row(*args)

    def _row(self, *args: Tree) -> Tree:
        try:
            return self._last(*args)
        except (ShapeMismatch, TypeError):  # other shapes, or another number of arguments
            pass
        key = tuple(tree_shape(x, f"argument {k}") for k, x in enumerate(args))
        if key not in self._steps:
            self._steps[key] = Function(self._text, args, self._requested_backend)
        step = self._steps[key]
        self._last, self.backend = step.call, step.backend
        return step(*args)

    def __getattr__(self, name: str) -> Tree:
        return getattr(object.__getattribute__(self, "block"), name)

    def __repr__(self) -> str:
        return f"compiled({self.block!r})"


def _raise_never_called(*args: Tree) -> Tree:
    raise ShapeMismatch.of("engine.not-compiled")


def _argument_names(f: Callable[..., Tree], count: int) -> list[str]:
    try:
        names = list(inspect.signature(f).parameters)
    except (TypeError, ValueError):
        names = []
    return names if len(names) == count else [f"argument {k}" for k in range(count)]
