"""Make a `Program` runnable in C: functions of a library, each compiled when it is first called."""

import ctypes
import os
import sys
from collections.abc import Callable, Sequence
from functools import cached_property, partial

import numpy as np

from baqueano.symbolic.c_code import c_bodies, compile
from baqueano.symbolic.c_code.c_text import header
from baqueano.symbolic.graph.carried import with_carried_functions
from baqueano.symbolic.graph.emit import with_reciprocals
from baqueano.symbolic.graph.program import Array, Program

POINTER, COUNT = ctypes.c_void_p, ctypes.c_int64
ARGUMENTS = (COUNT, *[POINTER] * 3, ctypes.c_double, *[POINTER] * 3)
BATCH_ARGUMENTS = (COUNT, COUNT, *[POINTER] * 6)

MIN_THREAD_TICKS = 100_000  # smallest number of vehicles times ticks for a thread
TANGENT_FUNCTIONS = ("sensitivities", "gradient", "normal_equations")


def make_kernel(program: Program) -> "CKernel":
    """Return the kernel of a program, not compiled yet."""
    return CKernel(program)


class CKernel:
    """The kernel in C. Arrays are float64 and C-contiguous; the caller owns the arrays that are filled."""

    def __init__(self, program: Program) -> None:
        self._given_program = program
        self.is_quick = program.is_quick
        self.texts: dict[tuple, str] = {}
        self.functions: dict[tuple, Callable[..., None]] = {}
        self.libraries: dict[tuple, ctypes.CDLL] = {}
        self.lower_mask = np.tri(len(program.theta), k=-1, dtype=bool)

    @cached_property
    def fingerprint(self) -> bytes:
        """Return the digest of the program."""
        return self._given_program.fingerprint

    @cached_property
    def program(self) -> Program:
        """Return the program in its own graph, from which code is generated."""
        return self._given_program.copy()

    @property
    def source(self) -> str:
        """Return the C code generated so far, or the code of `run` if none was generated."""
        if not self.texts:
            self._text("values")
        return "\n".join(self.texts.values())

    def run(self, theta: Array, start: Array, inputs: Array, outputs: Array, final: Array) -> None:
        """Run all ticks: fill outputs (N, m), and final (c,), the carry after the last tick."""
        addresses = _addresses(theta, start, inputs)
        self._function("values")(len(inputs), *addresses, 0.0, *_addresses(outputs, final), None)

    def bind(
        self, theta: Array, start: Array, inputs: Array, outputs: Array, result: Array, method: str = "run"
    ) -> Callable[[], object]:
        """Return `run` or `sensitivities` bound to these arrays, whose addresses are read once.

        The call holds Python's GIL, because a tick takes only microseconds and must not wait for the GIL.
        """
        arrays = theta, start, inputs, outputs, result
        addresses = np.array([len(inputs), *_addresses(*arrays)], dtype=np.int64)
        name = "values" if method == "run" else method
        self._function(name, is_quick=True)  # for one tick, the call costs more than the arithmetic
        entry_point = ctypes.PYFUNCTYPE(ctypes.c_int, POINTER)(("again", self.libraries[name, True]))
        call = partial(entry_point, POINTER(addresses.ctypes.data))  # converted once
        call.__dict__["given"] = addresses, arrays  # keeps the arrays alive as long as the call
        return call

    def sensitivities(
        self, theta: Array, start: Array, inputs: Array, outputs: Array, d_outputs: Array
    ) -> None:
        """Fill outputs (N, m), and d_outputs (N, m, p) with their derivatives with respect to theta."""
        addresses = _addresses(theta, start, inputs)
        function = self._function("sensitivities", is_quick=True)  # -O3 takes twice as long for long programs
        function(len(inputs), *addresses, 0.0, *_addresses(outputs, d_outputs), None)

    def total(
        self, theta: Array, start: Array, inputs: Array, with_gradient: bool
    ) -> tuple[float, Array | None]:
        """Return the sum of the only output over the ticks, and its gradient (p,), or None if not `with_gradient`."""
        cost, gradient_sum = np.zeros(1), np.zeros(len(theta))
        function = self._function("gradient" if with_gradient else "cost")
        function(len(inputs), *_addresses(theta, start, inputs), 0.0, *_addresses(cost, gradient_sum), None)
        return float(cost[0]), gradient_sum if with_gradient else None

    def normal_equations(
        self, theta: Array, start: Array, inputs: Array, huber: float | None
    ) -> tuple[float, Array, Array]:
        """Return Σ ρ of the outputs as residuals, its gradient (p,), and Σ w ∂r ∂rᵀ (p, p)."""
        cost, gradient, upper = np.zeros(1), np.zeros(len(theta)), np.zeros((len(theta), len(theta)))
        huber_limit = np.inf if huber is None else huber
        addresses = _addresses(theta, start, inputs)
        function = self._function("normal_equations")
        function(len(inputs), *addresses, huber_limit, *_addresses(cost, gradient, upper))
        return float(cost[0]), gradient, np.where(self.lower_mask, upper.T, upper)

    def batch(
        self,
        theta: Array,
        start: Array,
        shared_inputs: Array,
        own_inputs: Array,
        is_shared: Sequence[bool],
        outputs: Array | None,
        final: Array,
    ) -> None:
        """Run L vehicles: theta (L, p), start (L, s). Fill final (L, c), and outputs (L, N, m) if it is not None.

        Inputs that are True in `is_shared` are columns of shared (N, ·), the others columns of own (L, N, ·).
        """
        function = self._function("batch", tuple(is_shared), outputs is not None, is_quick=self.is_quick)

        def run(vehicles: slice) -> None:
            to = None if outputs is None else outputs[vehicles].ctypes.data
            addresses = _addresses(theta[vehicles], start[vehicles], shared_inputs, own_inputs[vehicles])
            function(len(shared_inputs), len(final[vehicles]), *addresses, to, *_addresses(final[vehicles]))

        slices = _thread_slices(len(final), len(shared_inputs))
        if len(slices) == 1:
            run(slices[0])
        else:
            from concurrent.futures import ThreadPoolExecutor

            with ThreadPoolExecutor(len(slices)) as pool:  # ctypes releases the GIL
                list(pool.map(run, slices))

    def _text(self, name: str, *options) -> str:
        key = (name, *options)
        if key not in self.texts:
            if name in TANGENT_FUNCTIONS:
                program = self._derivative_program
            else:
                program = with_reciprocals(self._without_final_carry if name == "cost" else self.program, 2)
            self.texts[key] = getattr(c_bodies, name)(program, *options)
        return self.texts[key]

    @cached_property
    def _without_final_carry(self) -> Program:
        """Return the program for functions that do not return the carry."""
        return with_carried_functions(self.program)

    @cached_property
    def _derivative_program(self) -> c_bodies.DerivativeProgram:
        # the derivative of x/y with respect to y needs 1/y anyway
        return c_bodies.differentiate(with_reciprocals(self._without_final_carry, 1))

    def _function(self, name: str, *options, is_quick: bool = False) -> Callable[..., None]:
        key = (name, is_quick, *options)
        if key not in self.functions:
            with self._given_program.graph.lock:
                if key not in self.functions:
                    self.functions[key] = self._compile(key, name, options, is_quick)
        return self.functions[key]

    def _compile(self, key: tuple, name: str, options: tuple, is_quick: bool) -> Callable[..., None]:
        def code() -> tuple[str, int]:
            body = self._text(name, *options)
            return header(body, self.program.tables) + body, body.count(" = ")

        library = self.libraries[key] = compile.load_library(
            (self.fingerprint, name, options),
            code,
            find_vectors=name == "batch",  # only then √ and ⌊ ⌋ of eight lanes become vectors
            is_quick=is_quick,
        )
        function = library.kernel
        function.argtypes = BATCH_ARGUMENTS if name == "batch" else ARGUMENTS
        function.restype = None
        return function


def _addresses(*arrays: Array) -> list[int]:
    return [array.__array_interface__["data"][0] for array in arrays]  # faster than ctypes.data


def _thread_slices(count: int, n: int) -> list[slice]:
    """Return the slice of vehicles for each thread, in whole vectors; one slice if more threads would not be faster."""
    processors = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
    threads = min(processors, count // c_bodies.LANE_COUNT, count * n // MIN_THREAD_TICKS)
    if threads < 2:
        return [slice(0, count)]
    size = -(-count // (threads * c_bodies.LANE_COUNT)) * c_bodies.LANE_COUNT
    return [slice(first, min(first + size, count)) for first in range(0, count, size)]
