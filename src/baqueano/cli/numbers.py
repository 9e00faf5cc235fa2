"""Parse numbers on the command line, which must be finite and in their range. Each error has one sentence."""

import math
from typing import Any

import click

from baqueano.errors import UsageError


class Number(click.ParamType):
    """A finite number of `unit`, which can be "", from `low` to `high`; with `excludes_low` above `low`."""

    name, code, parse = "number", "cli.number", float

    def __init__(
        self, unit: str, low: float = 0.0, high: float = math.inf, excludes_low: bool = True
    ) -> None:
        self.low, self.high, self.excludes_low = low, high, excludes_low
        upper_text = f", ≤ {high:g}" if math.isfinite(high) else ""
        unit_text = f" [{unit}]" if unit else ""
        self.range = f"{'>' if excludes_low else '≥'} {low:g}{upper_text}{unit_text}"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the typed number. Raise UsageError for any other text, and for a number outside the range."""
        try:
            x = self.parse(value)
        except ValueError:
            x = math.nan
        is_above_low = x > self.low if self.excludes_low else x >= self.low
        if not (is_above_low and x <= self.high and math.isfinite(x)):
            raise UsageError.of(self.code, option=_name(param), value=value, expected=self.range)
        return x


class WholeNumber(Number):
    """A whole number from `low` to `high`."""

    name, code, parse = "integer", "cli.whole-number", int

    def __init__(self, low: int, high: float = math.inf) -> None:
        super().__init__("", low, high, excludes_low=False)


def parse_bounds(argument: str) -> tuple[str, tuple[float, float]]:
    """Return ("model.friction.linear", (0, 10)) for "model.friction.linear=0,10". Raise UsageError for other text."""
    key, _, limits = argument.partition("=")
    try:
        low, high = (float(x) for x in limits.split(","))
    except ValueError as error:
        raise UsageError.of("cli.bound", f"--bound {key}=0,10", value=argument) from error
    return key, (low, high)


def _name(param: click.Parameter | None) -> str:
    return param.opts[0] if param is not None else ""


seconds = Number("s", high=86_400.0)
time_s = Number("s", excludes_low=False)
speed = Number("m/s", high=100.0)
length = Number("m", high=10_000.0)
count = WholeNumber(1)
count_or_none = WholeNumber(0)
pace = Number("", 0.05, 50.0, excludes_low=False)
