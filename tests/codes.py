"""Check errors by their code and figures; the catalogue of each language contains their sentences."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from baqueano.diagnostics import Diagnostic
from baqueano.errors import DiagnosticError


def of_code(code: str, **figures: Any) -> Callable[[Any], bool]:
    """Return a check that an error has exactly this code and at least these figures."""
    return lambda error: error.diagnostic.code == code and figures.items() <= error.diagnostic.figures.items()


def within(diagnostic: Diagnostic) -> Iterator[Diagnostic]:
    """Return a diagnostic and its causes."""
    yield diagnostic
    for figure in diagnostic.figures.values():
        if isinstance(figure, Diagnostic):
            yield from within(figure)


@contextmanager
def refused(
    code: str, kind: type[Exception] = DiagnosticError, /, **figures: object
) -> Iterator[pytest.ExceptionInfo[Exception]]:
    """Check that the block raises an error of this type, code and figures, or an error with such a cause."""
    with pytest.raises(kind) as error_info:
        yield error_info
    assert isinstance(error_info.value, DiagnosticError), str(error_info.value)
    causes = {cause.code: cause for cause in within(error_info.value.diagnostic)}
    assert code in causes, str(error_info.value)
    assert {name: causes[code].figures[name] for name in figures} == figures


def includes(diagnostic: Diagnostic, code: str, /, **figures: object) -> bool:
    """Return True if the diagnostic, or one of its causes, has this code and at least these figures."""
    return any(
        cause.code == code and {name: cause.figures.get(name) for name in figures} == figures
        for cause in within(diagnostic)
    )
