"""English sentences of the door: drivers from outside, and the protocol between laptop and vehicle."""

from baqueano.diagnostics import StopReason as S

TEMPLATES: dict[str, str] = {
    S.HOLDER_SILENT: (
        "no message from the operator for {silent_ms:.0f} ms: ssh, Wi-Fi or the terminal is gone"
    ),
    S.STOPPED_BY: "{words}",
    S.STOPPED_FROM_LAPTOP: "stopped from the laptop",
    S.STOPPED_BY_COMMAND: "stopped with baqueano robot stop",
    "door.own-mission": "Your last mission is still running. Wait for its end, or stop it.",
    "door.mission": "This vehicle is on a mission now. You may stop it: {fix}",
    "door.somebody": "Another person drives this vehicle now. You may stop it: {fix}",
    "door.somebody-waits": (
        "Another person has this vehicle between two drives. It is at rest, and their program may drive it at any "
        "moment. Wait until that program has ended."
    ),
    "door.not-understood": "The vehicle did not understand this request ({error})",
    "door.version": (
        "This computer and the vehicle have different versions of baqueano: this one uses version {theirs} of the "
        "door, the vehicle version {ours}. Install the newer one on both; onto the vehicle with: {fix}"
    ),
    "door.version-of-robot": (
        "{host} and this computer have different versions of baqueano: the vehicle uses version {theirs} of the door, "
        "this computer version {ours}. Install the newer one on both; onto the vehicle with: {fix}"
    ),
}
