"""Define the methods of a scan: a step that is repeated over time, with its derivatives, costs and batches."""

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.errors import Invalid
from baqueano.symbolic.graph.program import NormalEquations
from baqueano.symbolic.graph.tree import tree_shape


class Scan(ABC):
    """A step that is ready to run over time, made by `scan`. Leaves of `inputs` begin with the axis N of the ticks.

    Parameters
    ----------
    step : callable
        The same as for `scan`.
    carry : tree
        The carry at the start, or a function of theta that returns the carry; methods accept another start.
    inputs : tree
        An example of the inputs of one tick.
    theta : ndarray (p,) or None
        An example of the parameters [unit of each].

    Examples
    --------
    >>> from baqueano.symbolic import scan
    >>> kernel = scan(lambda p, v, u: (v + 0.1 * (u - p[0] * v), v), 0.0, 0.0, theta=[0.5])
    >>> y, slopes = kernel.sensitivities(np.ones(3), [0.5])
    >>> print(slopes[:, 0, 0])
    [ 0.    0.   -0.01]
    """

    def __init__(
        self, step: Callable[..., Tree], carry: Tree, inputs: Tree, theta: np.ndarray | None
    ) -> None:
        self.step = step
        self.parameters = None if theta is None else len(theta)
        self.carry_function = carry if callable(carry) else None
        if self.carry_function is not None:
            carry = carry(theta) if theta is not None else carry()
        self.example = carry
        self.carry_shape = tree_shape(carry, "carry")
        self.input_shape = tree_shape(inputs, "inputs")

    @property
    @abstractmethod
    def backend(self) -> str:
        """Return the back end in use: "c", "python" or "numpy"."""

    @property
    def operations(self) -> int:
        """Return the number of operations in one tick; 0 without a trace."""
        return 0

    @property
    def source(self) -> str:
        """Return the generated code; "" without a trace."""
        return ""

    @property
    def unused_carry(self) -> tuple[str, ...]:
        """Return the names of carry entries on which outputs do not depend; derivatives, costs and fits omit them."""
        return ()

    @abstractmethod
    def part(self, name: str) -> "Scan":
        """Return the scan whose output is only the field `name` of the output; the step is not traced again."""

    @abstractmethod
    def run(self, inputs: Tree, theta: Tree = None, carry: Tree = None) -> tuple[Tree, Tree]:
        """Return the carry after the last tick, and the outputs, whose leaves begin with the axis N."""

    @abstractmethod
    def sensitivities(self, inputs: Tree, theta: Tree, carry: Tree = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the values of the outputs (N, m), and their derivatives with respect to θ (N, m, p)."""

    @abstractmethod
    def bind_sensitivities(self, inputs: Tree) -> Callable[[np.ndarray, np.ndarray], Tree]:
        """Return `sensitivities` for these inputs, as a fast function of θ (p,) and a carry that is one array.

        Each call fills the arrays of the result of the previous call.
        """

    @abstractmethod
    def cost(self, inputs: Tree, theta: Tree = None, carry: Tree = None) -> float:
        """Return the sum of the output over the ticks. Raise Invalid if the output is not one number per tick."""

    @abstractmethod
    def cost_and_gradient(self, inputs: Tree, theta: Tree, carry: Tree = None) -> tuple[float, np.ndarray]:
        """Return the sum of the output (one number per tick) over the ticks, and its gradient (p,)."""

    @abstractmethod
    def normal_equations(
        self, inputs: Tree, theta: Tree, huber: float | None = None, carry: Tree = None
    ) -> NormalEquations:
        """Return the cost Σ ρ(r), its gradient (p,), and Σ w ∂r ∂rᵀ (p, p), with the outputs as whitened residuals r.

        With `huber` = k, ρ grows linearly beyond k.
        """

    @abstractmethod
    def batch(
        self, inputs: Tree, theta: Tree = None, carry: Tree = None, with_outputs: bool = False
    ) -> tuple[Tree, Tree]:
        """Run a batch of L: theta (L, p), leaves of `carry` (L, …) or shared, leaves of `inputs` (L, N, …) or shared.

        Return the carry after the last tick (L, …), and the outputs (L, N, …), or None without `with_outputs`.
        """

    @abstractmethod
    def batch_sums(
        self, inputs: Tree, theta: Tree, derivative_count: int = 0, carry: Tree = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Run a batch of L, as in `batch`, and return the sums of the outputs over the ticks (L, m).

        Also return the derivatives of these sums with respect to the first `derivative_count` entries of θ, (L, m,
        derivative_count).
        """

    def _theta(self, theta: Tree, is_batch: bool = False) -> np.ndarray:
        expected_shape = "(L, p)" if is_batch else "(p,)"
        if self.parameters is None:
            if theta is not None:
                raise Invalid.of("engine.no-theta")
            return np.zeros(0)
        if theta is None:
            raise Invalid.of("engine.theta-missing", parameters=self.parameters, expected=expected_shape)
        theta = np.ascontiguousarray(theta, dtype=float)
        if theta.ndim != 1 + is_batch or theta.shape[-1] != self.parameters:
            raise Invalid.of(
                "engine.theta-shape",
                value=str(theta.shape),
                expected=expected_shape,
                parameters=self.parameters,
            )
        return theta

    def _need_theta(self) -> None:
        if self.parameters is None:
            raise Invalid.of("engine.no-parameters")
