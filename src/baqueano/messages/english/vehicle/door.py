"""English sentences about connections: external drivers, and the protocol between laptop and vehicle."""

from baqueano.diagnostics import StopReason as S

TEMPLATES: dict[str, str] = {
    S.HOLDER_SILENT: (
        "no message from the operator for {silent_ms:.0f} ms: the browser, ssh, Wi-Fi or the terminal was lost"
    ),
    S.STOPPED_BY: "{words}",
    S.STOPPED_ON_PAGE: "{name} pressed STOP on the page",
    S.STOPPED_FROM_LAPTOP: "stopped from the laptop",
    S.STOPPED_BY_COMMAND: "the vehicle was stopped with the command baqueano robot stop",
    "door.own-mission": "Your last mission is still running. Wait for its end, or stop it.",
    "door.mission": "This vehicle is on a mission. You can stop it: {fix}",
    "door.other-driver": "Another person drives this vehicle now. You can stop it: {fix}",
    "door.other-reservation": (
        "The program of another person reserves this vehicle between two drives. The vehicle is at "
        "rest, but that program can drive it at any moment. Wait until the program has ended."
    ),
    "door.not-understood": "The vehicle could not read this request ({error})",
    "door.version": (
        "This computer and the vehicle have different versions of baqueano: the protocol here is "
        "version {laptop_protocol}, on the vehicle {robot_protocol}. Install the newer one on both. On the vehicle: "
        "{fix}"
    ),
    "door.version-of-robot": (
        "{host} and this computer have different versions of baqueano: the protocol of the "
        "vehicle is version {robot_protocol}, here {laptop_protocol}. Install the newer one on both. On the "
        "vehicle: {fix}"
    ),
    "remote.connection-lost": "{host}: the connection was lost ({error}). The vehicle stops.",
    "remote.silent": (
        "{host} did not answer within {limit_s:g} s. Does its service run? Type there: "
        "systemctl status baqueano"
    ),
    "remote.closed": "{host}: the connection was closed. The vehicle stops by itself. To see why, type: {fix}",
    "remote.run-name": (
        '{host} sent a run with the name "{run}"; expected a plain name such as lap.mcap. Nothing was '
        "written."
    ),
    "remote.run-too-long": (
        "{run} at {host} has {size_mb:.0f} MB, but this disk has {free_mb:.0f} MB free (a run has at most "
        "{longest_gb} GB). Free some space, and type the same line again"
    ),
    "remote.run-otherwise": "{host} announced {run}, but sent other data. Type the same line again.",
    "remote.no-ssh": "{host} cannot be reached: ssh is missing on this machine. Install OpenSSH.",
    "remote.no-sockets": (
        "{path}: this system does not support file sockets. Name the vehicle by its host name."
    ),
    "remote.stop-unconfirmed": (
        "{host} did not confirm the stop. Type the command again, or use the switch of the vehicle."
    ),
    "remote.stop-not-reached": (
        "{host} confirmed the stop, but did not reach the state STOPPED within {limit_s:g} s: "
        "its last state was {state}. A drive in preparation ends before the vehicle moves. Look "
        "at the vehicle, then type: baqueano robot status {host}"
    ),
    "remote.unreachable": "{host} cannot be reached: {cause}. To see why: {command}",
    "door.unknown-word": "{value} is not valid: expected one of {valid}",
    "door.no-run": "Run {run} does not exist",
    "door.full": "All {maximum} places at this vehicle are occupied. Close a page or a program that watches it.",
    "door.too-long": (
        "A line longer than {max_kb} kB can only be a mission, and one mission is read at a time. Send it again."
    ),
    "door.too-many": "{count} requests arrived too fast, and were dropped. Send fewer at a time.",
    "door.many-fetches": "{maximum} runs are being sent already. Wait until one has arrived.",
    "door.not-holder": "Only the person who drives can set a gain, and only while the vehicle drives.",
    "door.not-settable": (
        "{path} cannot be set while the vehicle drives; the values that can be set are {valid}"
    ),
    "door.block-replaced": "{kind} is used as {role}, instead of the block of the vehicle file",
    "door.set": "{path} is now {value}; it was {former_value}",
    "door.pace": "pace {value:g}: expected a factor from {min_factor:g} to {max_factor:g}",
    "door.guide-pace": "guide.pace = {value}: expected a number from 0 (the vehicle waits) to 1",
    "door.route-name": (
        "{value} cannot be the name of a route. Use letters, digits and hyphens, such as lab-1."
    ),
    "door.no-route": "Route {value} does not exist; the stored routes are {valid}. Teach it first.",
    "door.not-a-number": "{name} = {value}: expected a number",
    "door.not-an-integer": "{name} = {value}: expected an integer",
    "door.gain-refused": (
        "{name} = {value}: the controller does not accept this value, so the vehicle drives on with {former_value}: "
        "{error}"
    ),
    "door.runs-already": "{path}: a service is already running on this vehicle. Type: {fix}",
    "ssh.host": (
        'HOST "{host}": expected the ssh name of a vehicle, which is one word that begins with a letter or '
        "a digit, such as pilot@rover.local"
    ),
    "ssh.no-hardware": (
        "{host} does not have hardware: expected a vehicle by ssh, such as pilot@rover.local, or no HOST "
        "for the hardware of this computer. With {host}, only drives are possible. Type: {fix}"
    ),
    "ssh.not-a-host": (
        "{host} is not a vehicle by ssh, such as pilot@rover.local. For an Uno at this computer, write its "
        "port into the vehicle file, or type: --set robot.port={host}"
    ),
    "ssh.too-much": "The answer of the vehicle is longer than {max_mb} MB, so the rest was not read.",
    "door.no-answer": (
        "{path}: no service answers there ({error}). On the vehicle type: {fix}. From a laptop, name the "
        "vehicle, for example pilot@rover.local"
    ),
    "door.state": "The vehicle is {state}. {advice}.",
    "door.state-because": "The vehicle is {state}: {cause}. {advice}.",
    "door.correct-and-wait": "Correct that; the vehicle checks again by itself",
    "door.clear": "Look at the vehicle, then type: {fix}",
    "door.wait": "Wait until it is done, or stop it: {fix}",
}
