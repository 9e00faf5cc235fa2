"""Create table rows that compare a result of a recording with its criterion (bar)."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject


def criterion_row(recording: str, quantity: str, value: object, bar: str, ok: bool) -> "JsonObject":
    """Return a row of a table of recordings: a value, its criterion, and True if it is met."""
    return {"recording": recording, "quantity": quantity, "value": value, "bar": bar, "ok": bool(ok)}
