"""English sentences of the door: drivers from outside, and the protocol between laptop and vehicle."""

from baqueano.diagnostics import StopReason as S

TEMPLATES: dict[str, str] = {
    S.HOLDER_SILENT: "nobody has been heard for {silent_ms:.0f} ms: ssh, Wi-Fi or the terminal is gone",
    S.STOPPED_BY: "{words}",
    S.STOPPED_FROM_LAPTOP: "stopped from the laptop",
    S.STOPPED_BY_COMMAND: "stopped with baqueano robot stop",
    "door.own-mission": "your last mission is still driven. Wait for its end, or stop it.",
    "door.mission": "this vehicle drives a mission just now. You may stop it: {fix}",
    "door.somebody": "somebody else drives this vehicle just now. You may stop it: {fix}",
    "door.somebody-waits": (
        "somebody else has this vehicle between two drives: it stands, and their program may drive it at any moment. "
        "Wait until that has ended."
    ),
    "door.not-understood": "this was not understood ({error})",
    "door.version": (
        "this computer has another baqueano than the vehicle: it speaks version {theirs} of the door, the vehicle "
        "version {ours}. Put the newer one on both; onto the vehicle with: {fix}"
    ),
    "door.version-of-robot": (
        "{host} has another baqueano than this computer: it speaks version {theirs} of the door, this computer version "
        "{ours}. Put the newer one on both; onto the vehicle with: {fix}"
    ),
}
