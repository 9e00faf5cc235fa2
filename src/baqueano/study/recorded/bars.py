"""A figure of a recording beside the bar that it is held to."""

from typing import Any


def row(recording: str, quantity: str, value: Any, bar: str, ok: bool) -> dict[str, Any]:
    """One row of a table of recordings."""
    return {"recording": recording, "quantity": quantity, "value": value, "bar": bar, "ok": bool(ok)}
