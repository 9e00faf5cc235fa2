"""Numbers on the command line: finite, in their range, and told so in one sentence."""

import math
from typing import Any

import click


class Number(click.ParamType):
    """A finite number of `unit` from `low` (without it, if `above`) to `high`."""

    name = "number"

    def __init__(self, unit: str, low: float = 0.0, high: float = math.inf, above: bool = True) -> None:
        self.unit, self.low, self.high, self.above = unit, low, high, above

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """What was typed as a number; refused with the range where it is none or outside."""
        try:
            x = float(value)
        except ValueError:
            x = math.nan
        enough = x > self.low if self.above else x >= self.low
        if not (enough and x <= self.high and math.isfinite(x)):
            lower = f"{'above' if self.above else 'from'} {self.low:g}"
            upper = f" and at most {self.high:g}" if math.isfinite(self.high) else ""
            self.fail(f"{value} is refused: expected a number {lower}{upper} [{self.unit}].", param, ctx)
        return x


seconds = Number("s", high=86_400.0)
moment = Number("s", above=False)
speed = Number("m/s", high=100.0)
length = Number("m", high=10_000.0)
count = click.IntRange(min=1)
count_or_none = click.IntRange(min=0)
