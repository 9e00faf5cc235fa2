"""Create table rows that compare a result of a recording with its criterion."""

from baqueano.contracts.values import JsonObject
from baqueano.messages.language import number, translate as _


def criterion_row(recording: str, quantity: str, value: object, criterion: str, ok: bool) -> JsonObject:
    """Return a row of a table of recordings: a value, its criterion, and True if it is met."""
    return {"recording": recording, "quantity": quantity, "value": value, "bar": criterion, "ok": bool(ok)}


def minimum_row(recording: str, quantity: str, value: float, criterion: float) -> JsonObject:
    """Return the row of a value that must be at least `criterion`."""
    return criterion_row(recording, quantity, value, f"≥ {number(criterion):g}", value >= criterion)


def maximum_row(recording: str, quantity: str, value: float, criterion: float, unit: str = "") -> JsonObject:
    """Return the row of a value that must be at most `criterion`, which is shown with its `unit`."""
    return criterion_row(recording, quantity, value, f"≤ {number(criterion):g}{unit}", value <= criterion)


def within(recording: str, quantity: str, value: float, expected: float, tolerance: float) -> JsonObject:
    """Return the row of a value that must differ from `expected` by at most `tolerance`."""
    criterion = f"{number(expected):g} ± {number(tolerance):g}"
    return criterion_row(recording, quantity, value, criterion, abs(value - expected) <= tolerance)


def message_row(recording: str, message: str, is_reported: bool) -> JsonObject:
    """Return the row of a message that must be reported."""
    return criterion_row(recording, message, is_reported, _("yes"), is_reported)
