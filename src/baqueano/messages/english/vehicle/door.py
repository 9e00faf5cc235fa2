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
    "remote.gone": "{host}: the connection is gone ({error}). The vehicle stops.",
    "remote.silent": (
        "{host} said nothing for {within_s:g} s. Is its service up? Type there: systemctl status baqueano"
    ),
    "remote.closed": "{host}: the connection was closed. The vehicle stops by itself. To see why, type: {fix}",
    "remote.run-name": '{host} names a run "{run}", expected a plain name as lap.mcap. Nothing was written.',
    "remote.run-too-long": (
        "{run} at {host} has {size_mb:.0f} MB, and {free_mb:.0f} MB are free here; no run is longer than "
        "{longest_gb} GB. Make room, and type it again"
    ),
    "remote.run-otherwise": "{host} sent {run} otherwise than it said. Type it again.",
    "remote.no-ssh": "{host} cannot be reached: ssh is missing on this machine. Install OpenSSH.",
    "remote.no-sockets": (
        "{path}: this system does not support sockets in files. Name the vehicle by its host name."
    ),
    "remote.stop-not-heard": (
        "{host} did not say that it heard the stop. Type it again, or use the switch of the vehicle."
    ),
    "remote.stop-not-seen": (
        "{host} heard the stop, and was not seen STOPPED within {within_s:g} s: its last state was {state}. A "
        "drive that it prepares ends before anything moves. Look at the vehicle, then type: baqueano robot "
        "status {host}"
    ),
    "remote.unreachable": "{host} cannot be reached: {cause}. To see why: {command}",
    "door.unknown-word": "{found} is not one of {known}",
    "door.no-run": "run {run} does not exist",
    "door.full": "All {most} places at this vehicle are occupied. Close a page or a program that watches it.",
    "door.too-long": (
        "A line longer than {most_kb} kB can only be a mission, and one mission is read at a time. Send it again."
    ),
    "door.too-many": "{dropped} requests came too fast, and were dropped. Send fewer at a time.",
    "door.many-fetches": "{most} runs are being sent already. Wait until one has arrived.",
    "door.not-holder": "Only the person who drives can set a gain, and only while the vehicle drives.",
    "door.not-settable": "{path} cannot be set while the vehicle drives; what can be set is {known}",
    "door.swapped": "{kind} drives as {room}, in place of the block of the vehicle file",
    "door.set": "{path} is now {now}, before it was {before}",
    "door.pace": "pace {found:g}: expected a factor from {slowest:g} to {fastest:g}",
    "door.route-name": "{found} cannot be the name of a route. Use letters, digits and hyphens, as in lab-1.",
    "door.no-route": "route {found} does not exist; stored are {known}. Teach it first.",
    "door.not-a-number": "{name} = {found}: expected a number",
    "door.runs-already": "{path}: a service runs already on this vehicle. Type: {fix}",
    "ssh.host": (
        'HOST "{host}": expected the name of a vehicle that ssh reaches, which begins with a letter or a'
        " digit and is one word. Type it as pilot@rover.local"
    ),
    "ssh.no-hardware": (
        "{host} is not hardware: expected a vehicle that ssh reaches, pilot@rover.local, or nothing, for"
        " what is plugged in here. It can only drive: baqueano experiment --robot {host}"
    ),
    "ssh.not-a-host": (
        "{host}: expected a vehicle that ssh reaches, pilot@rover.local. The port of an Uno that is plugged in "
        "here stands in the vehicle file; or type: --set robot.port={host}"
    ),
    "ssh.too-much": "the vehicle answered more than {most_mb} MB, and was not heard to its end.",
    "door.nobody": (
        "{path}: no service answers there ({error}). On the vehicle type: {fix}; from a laptop name the vehicle, as "
        "pilot@rover.local"
    ),
    "door.state": "the vehicle is {state}. {advice}.",
    "door.state-because": "the vehicle is {state}: {cause}. {advice}.",
    "door.mend": "Mend that; it is checked again by itself",
    "door.clear": "Look at the vehicle, then type: {fix}",
    "door.wait": "Wait until it is done, or stop it: {fix}",
}
