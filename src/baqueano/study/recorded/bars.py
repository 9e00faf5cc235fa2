"""A figure of a recording beside the bar that it is held to."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject


def row(recording: str, quantity: str, value: object, bar: str, ok: bool) -> "JsonObject":
    """A row of a table of recordings."""
    return {"recording": recording, "quantity": quantity, "value": value, "bar": bar, "ok": bool(ok)}
