"""Text for people and figures for machines: results on stdout, talk on stderr, any encoding."""

import codecs
import json
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TextIO

import click

_LETTERS = {
    "α": "alpha", "β": "beta", "γ": "gamma", "δ": "delta", "η": "eta", "μ": "mu", "ν": "nu", "π": "pi",
    "ρ": "rho", "σ": "sigma", "Σ": "Sigma", "τ": "tau", "φ": "phi", "χ": "chi", "ψ": "psi", "ω": "omega",
    "ẋ": "x_dot", "ν̇": "nu_dot", "≤": "<=", "≥": ">=", "→": "->", "−": "-", "×": "x", "·": "*", "²": "^2",
    "³": "^3", "±": "+-", "°": " deg", "√": "sqrt ", "∞": "inf", "…": "...", "✓": "ok", "–": "-", "‖": "|",
    "₁": "1", "₂": "2", "₃": "3", "⁻": "^-", "¹": "1", "̇": "_dot", "Δ": "Delta", "≈": "~",
}  # fmt: skip


def _spell(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    lost = error.object[error.start : error.end]
    return "".join(_LETTERS.get(c, "?") for c in lost), error.end


def plain_letters(*streams: TextIO) -> None:
    """Where the terminal's encoding has no ψ, print psi: never fail over a letter."""
    codecs.register_error("baqueano", _spell)
    for stream in streams:
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="baqueano")


def talk(text: str) -> None:
    """A line for the person who waits; never part of the result."""
    click.echo(text, err=True)


def answer(result: Any, as_json: bool) -> None:
    """Print a result: its table for people, or one JSON object with `rows` and `verdict`."""
    if not as_json:
        click.echo(result.table())
        return
    reply = {"rows": [_known(row) for row in result.rows()], "verdict": result.verdict}
    click.echo(json.dumps(reply, allow_nan=False))


def _known(row: dict[str, Any]) -> dict[str, Any]:
    """NumPy numbers as Python's; NaN and infinity, which JSON has not, as null."""
    import numpy as np

    def plain(value: Any) -> Any:
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, np.ndarray | list | tuple):
            return [plain(v) for v in value]
        if isinstance(value, float) and not np.isfinite(value):
            return None
        return value

    return {name: plain(value) for name, value in row.items()}


@contextmanager
def progress(label: str, length: int) -> Iterator[Callable[[int], None]]:
    """A bar on stderr for anything that takes long; silent when nobody looks.  Yields advance(n)."""
    with click.progressbar(length=length, label=label, file=sys.stderr, width=30) as bar:
        yield bar.update


def followed(label: str, items: Iterable[Any], length: int) -> Iterator[Any]:
    """`items`, one by one, with a bar on stderr."""
    with progress(label, length) as advance:
        for item in items:
            yield item
            advance(1)


@contextmanager
def clocked(label: str, duration_s: float) -> Iterator[Callable[[float], None]]:
    """A bar on stderr that follows the time of a run [s]; `duration_s` 0: no end is known."""
    done = 0

    def seen(t_s: float) -> None:
        nonlocal done
        advance(max(0, round(10 * t_s) - done))
        done = max(done, round(10 * t_s))

    with progress(label, max(1, round(10 * duration_s))) as advance:
        yield seen
