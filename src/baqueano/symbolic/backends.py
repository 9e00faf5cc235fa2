"""Choose the back end: "c" if a compiler is available, else "python"; "numpy" runs the code unchanged."""

import os
import sys

from baqueano.contracts.values import Value
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.errors import Invalid
from baqueano.messages import text
from baqueano.symbolic.graph.program import Kernel, Program
from baqueano.symbolic.python_code import python

BACKEND_NAMES = ("auto", "c", "python", "numpy")
_report_log: set[Diagnostic] = set()


def resolve_backend(backend: str) -> str:
    """Return `backend`; for "auto" the variable BAQUEANO_BACKEND, if it is set. Raise Invalid for an unknown name."""
    if backend == "auto":
        backend = os.environ.get("BAQUEANO_BACKEND", "") or "auto"
    if backend not in BACKEND_NAMES:
        raise Invalid.of("engine.backend", value=backend, valid=BACKEND_NAMES)
    return backend


class Runner:
    """The kernel of a program. "auto" begins with C and changes to Python if C cannot be compiled."""

    def __init__(self, program: Program, backend: str) -> None:
        self._program = program
        self.backend = "python" if backend == "python" else "c"
        self._may_change = backend == "auto"
        if self.backend == "python":
            self._kernel: Kernel = python.make_kernel(program)
            return
        from baqueano.symbolic.c_code import c, compile

        compiler = compile.find_compiler()
        self._kernel = c.make_kernel(program)
        if self._may_change and compiler.compiler is None:
            self._disable_c(compiler.reason)

    @property
    def source(self) -> str:
        """Return the generated code of the kernel."""
        return self._kernel.source

    def call(self, method: str, *args: Value) -> Value:
        """Call a method of the kernel and return its result; see program.Kernel."""
        if not self._may_change:
            return getattr(self._kernel, method)(*args)
        from baqueano.symbolic.c_code.compile import CompileError

        try:
            return getattr(self._kernel, method)(*args)
        except CompileError as error:
            self._disable_c(error.diagnostic)
            return getattr(self._kernel, method)(*args)

    def _disable_c(self, reason: Diagnostic | None) -> None:
        self.backend, self._may_change = "python", False
        self._kernel = python.make_kernel(self._program)
        if reason is not None and reason.code != "compiler.absent" and reason not in _report_log:
            _report_log.add(reason)
            print(
                f"baqueano: {text(note('compiler.python-used', Severity.WARNING, cause=reason))}",
                file=sys.stderr,
            )
