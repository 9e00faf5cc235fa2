"""Encode and decode the messages between a vehicle and its clients: lines of JSON, with diagnostics as data."""

import json
from dataclasses import replace

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic
from baqueano.messages.printable import printable_json, shell_command

# fields that can be diagnostics
DIAGNOSTIC_FIELDS = ("reason", "message", "diagnostic", "imu_bus", "degraded")
REQUIRED_FIELDS: dict[str, JsonObject] = {  # the required fields of a message; others are shown, or ignored
    "state": {"state": str}, "event": {"message": Diagnostic}, "done": {"run": str | None, "reason": Diagnostic | None},
    "runs": {"runs": list}, "file": {"data": str, "left": int}, "refused": {"reason": str}, "pong": {"token": object},
    "vehicle": {"name": str}, "fields": {"names": list}, "route": {"x": list, "y": list}, "frame": {"x": list},
    "routes": {"routes": list}, "over": {"reason": Diagnostic}, "ledger": {"rows": list}, "received": {"request": str},
}  # fmt: skip


REFUSED = {"type": "refused", "is": "refused"}  # `is` is for clients with an earlier version of the protocol
FORMER_FIELDS = {"is": "type", "do": "request"}  # of a robot with an earlier version of the protocol


def encode(message: JsonObject) -> bytes:
    """Return a message as a line of JSON. A field that is NaN becomes null, because JSON does not have NaN."""
    finite_message = {k: None if isinstance(v, float) and v != v else v for k, v in message.items()}
    return json.dumps(finite_message, default=_plain_data).encode() + b"\n"


def decode(line: bytes, host: str = "HOST") -> JsonObject | None:
    """Return the message in a line, with each text printable and on one line; None if the message is invalid.

    The commands that its diagnostics advise contain `host`, the address of the vehicle.
    """
    try:
        message = {FORMER_FIELDS.get(str(k), str(k)): v for k, v in printable_json(json.loads(line)).items()}
        message |= {
            k: _with_host(Diagnostic.from_json(message[k]), host)
            for k in DIAGNOSTIC_FIELDS
            if isinstance(message.get(k), dict)
        }
        is_valid = all(
            isinstance(message[name], kind) for name, kind in REQUIRED_FIELDS[message["type"]].items()
        )
        is_valid &= isinstance(message.get("code", 0), int)
        is_valid &= isinstance(message.get("diagnostic"), Diagnostic | None)
        return message if is_valid else None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def _with_host(diagnostic: Diagnostic, host: str) -> Diagnostic:
    words = [host if word == "HOST" else word for word in diagnostic.fix.split()]
    fix = shell_command(*filter(None, words)) if host in words else diagnostic.fix
    causes = {k: _with_host(v, host) for k, v in diagnostic.figures.items() if isinstance(v, Diagnostic)}
    return replace(diagnostic, fix=fix, figures={**diagnostic.figures, **causes})


def _plain_data(value: object) -> object:
    if isinstance(value, Diagnostic):
        return value.to_json()
    raise TypeError(f"{type(value).__name__} does not go through the door")
