"""One call made fast: `function` for a function, `compiled` for the step of a block.

The numbers of the arguments are written into one row of floats, the kernel of a scan of one tick fills
another, and that is read as the result. Types, None and text belong to the shape of an argument, and are
checked.

A filter carries many zeros: states that never correlate. Where the first state has zeros that stay so by induction,
the kernel is simplified for them, and looks at every call whether they are there; a general one is made if not.
"""

import inspect
from collections.abc import Callable
from functools import cache

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.symbolic.backends import Runner, chosen
from baqueano.symbolic.graph.assemble import assemble, lasting_zeros
from baqueano.symbolic.graph.program import Program
from baqueano.symbolic.graph.trace import trace_function
from baqueano.symbolic.graph.tree import Shape, shape_of
from baqueano.symbolic.packing import ShapeMismatch, caller, state_of
from baqueano.symbolic.scan import flat_row


def function(f: Callable[..., Tree], *examples: Tree, backend: str = "auto") -> "Function":
    """`f`, compiled for arguments like the examples: the same trees in and out."""
    return Function(f, examples, backend)


def compiled(block: Tree, backend: str = "auto") -> "Compiled":
    """`block` with a compiled `step`; its fields are constants, `init` and all else are its own.

    A step with a loop over time says so: `row` is the step of one input, which is compiled, and `pause(state, input)`
    gives those that come before this one.
    """
    return Compiled(block, backend)


class Function:
    """A function of numbers in trees, compiled when it is made."""

    def __init__(self, f: Callable[..., Tree], examples: tuple[Tree, ...], backend: str) -> None:
        self.f = f
        self._names = _argument_names(f, len(examples))
        self._shapes = [shape_of(x, name) for x, name in zip(examples, self._names, strict=True)]
        backend = chosen(backend)
        self.call = f  # the same with nothing asked: as many arguments as there were examples
        self._runner = None if backend == "numpy" else self._compile(backend, examples)
        self.backend = "numpy" if self._runner is None else self._runner.backend

    @property
    def source(self) -> str:
        """The text that runs."""
        return "" if self._runner is None else self._runner.source

    def __call__(self, *args: Tree, **kwargs: Tree) -> Tree:
        """f(*args); ValueError where an argument has another shape than its example."""
        if kwargs:
            args = inspect.signature(self.f).bind(*args, **kwargs).args
        if len(args) != len(self._shapes):
            raise TypeError(f"{len(args)} arguments, expected {len(self._shapes)}: {', '.join(self._names)}")
        return self.call(*args)

    def _compile(self, backend: str, examples: tuple[Tree, ...]) -> Runner:
        trace = trace_function(self.f, self._shapes)
        whole = assemble(trace, keep_all=True, given_start=True).program
        row, result = np.zeros((1, len(trace.inputs))), np.zeros((1, len(trace.outputs)))

        def bound(program: Program) -> tuple[Runner, Callable[[], object]]:
            made, nothing = Runner(program, backend), np.zeros(0)
            return made, made.call("bind", 1, nothing, nothing, row, result, nothing)

        runner, run = bound(self._with_zeros(whole, trace.output_shape, examples))
        general = cache(lambda: bound(whole)[1])
        self.call = caller(self._shapes, row[0], run, lambda: general()(), result[0], trace.output_shape)
        return runner

    def _with_zeros(self, program: Program, shape: Shape, examples: tuple[Tree, ...]) -> Program:
        """The program for states that are 0 where the example is, and where they stay so."""
        if state_of(self._shapes, shape) is None:
            return program
        zero = set(np.flatnonzero(flat_row(self._shapes[0], examples[0]) == 0.0).tolist())
        graph, inputs = program.graph, program.inputs
        zero = lasting_zeros(graph, inputs, program.outputs, zero)
        outputs = graph.substitute(program.outputs, {inputs[k]: graph.const(0.0) for k in zero})
        return program._replace(outputs=tuple(outputs), zeros=tuple(inputs[k] for k in sorted(zero)))


class Compiled:
    """A block whose step is compiled, when first called, for each shape of its arguments."""

    def __init__(self, block: Tree, backend: str = "auto") -> None:
        self.block = block
        self.backend = chosen(backend)
        self._asked = self.backend
        self._steps: dict[tuple[Shape, ...], Function] = {}
        self._last: Callable[..., Tree] = _never
        self._pause = getattr(block, "pause", None)
        self._text = block.step if self._pause is None else block.row

    def step(self, *args: Tree, **kwargs: Tree) -> Tree:
        """The step of the block."""
        if kwargs:
            args = inspect.signature(self.block.step).bind(*args, **kwargs).args
        if self._pause is not None:
            for before in self._pause(*args):
                args = (self._row(args[0], before)[0], *args[1:])
        return self._row(*args)

    def _row(self, *args: Tree) -> Tree:
        try:
            return self._last(*args)
        except (ShapeMismatch, TypeError):  # other shapes, or more of them
            pass
        key = tuple(shape_of(x, f"argument {k}") for k, x in enumerate(args))
        if key not in self._steps:
            self._steps[key] = Function(self._text, args, self._asked)
        made = self._steps[key]
        self._last, self.backend = made.call, made.backend
        return made(*args)

    def __getattr__(self, name: str) -> Tree:
        return getattr(object.__getattribute__(self, "block"), name)

    def __repr__(self) -> str:
        return f"compiled({self.block!r})"


def _never(*args: Tree) -> Tree:
    raise ShapeMismatch("nothing is compiled yet")


def _argument_names(f: Callable[..., Tree], count: int) -> list[str]:
    try:
        names = list(inspect.signature(f).parameters)
    except (TypeError, ValueError):
        names = []
    return names if len(names) == count else [f"argument {k}" for k in range(count)]
