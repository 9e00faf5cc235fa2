"""Write the first-boot files for a card with a stock 64-bit Raspberry Pi OS Lite: name, user, key, network.

One script makes all settings, and a screen is not needed (files/firstrun.sh). The image determines how the script is
started:

    no user-data on the boot partition (Bookworm)        systemd.run=… in cmdline.txt, then the Pi reboots     (1)
    user-data present, an image with cloud-init (Trixie) runcmd of user-data                                  (2)

The user logs in only by key, without a password; sudo does not request a password either. In a network that the robot
opens, its address is 10.42.0.1. A campus network separates its clients, so that a laptop does not reach the robot. Use
the robot's network, which serves about four clients, or a router of the class.

(1) and (2) were not tested on a real card: the script was run in a folder that represents the Pi. Raspberry Pi Imager
starts its script by (1), and cloud-init by (2).
"""

import re
import secrets
import shlex
import zlib
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from baqueano.errors import FileError, UsageError
from baqueano.messages.language import translate as _

FIRST_RUN_LINES = (
    "systemd.run=/boot/firmware/firstrun.sh",
    "systemd.run_success_action=reboot",
    "systemd.unit=kernel-command-line.target",
)
CLOUD_CONFIG = """#cloud-config
# written by baqueano robot card
runcmd:
  - [bash, -c, "[ ! -f /boot/firmware/firstrun.sh ] || bash /boot/firmware/firstrun.sh"]
"""
BOOT_FOLDERS = ("/media/*/bootfs", "/run/media/*/bootfs", "/Volumes/bootfs")
WIFI_CHANNELS = (1, 6, 11)  # channels that do not overlap; the robots of a class are distributed over them
# only in a name, which can also be a list of bytes: in a password GLib keeps the backslash
SSID_SEMICOLON = "\\;"
NAME_LETTERS = "abcdefghjkmnpqrstuvwxyz23456789"  # without characters that can be confused on a label


class Network(NamedTuple):
    """A Wi-Fi network to join, or, if `own` is True, a network that the robot opens."""

    ssid: str
    password: str
    country: str
    own: bool = False


def new_name() -> str:
    """Return a random host name, one of 2¹⁶, so that two robots of a class rarely have the same name."""
    return f"robot-{secrets.token_hex(2)}"


def new_password() -> str:
    """Return a random password of ten letters and digits, with 49 bits."""
    return "".join(secrets.choice(NAME_LETTERS) for _letter in range(10))


def boot_partition(folder: Path | None) -> Path:
    """Return the mounted boot partition: `folder`, or the only boot partition found if `folder` is None.

    Raise FileError if `folder` is not a boot partition, or if the search does not find exactly one.
    """
    if folder is None:
        partitions = [path for label in BOOT_FOLDERS for path in Path("/").glob(label.lstrip("/"))]
        if len(partitions) != 1:
            raise FileError.of("card.cards", cards=len(partitions))
        folder = partitions[0]
    if not (folder / "cmdline.txt").is_file() or not (folder / "config.txt").is_file():
        raise FileError.of("card.no-boot", folder=folder)
    return folder


def public_key(path: Path | None) -> str:
    """Return the text of the user's ssh key. Raise FileError for no key, or for a file without a public key."""
    candidates = (
        [path]
        if path
        else [Path.home() / ".ssh" / f"id_{key_type}.pub" for key_type in ("ed25519", "ecdsa", "rsa")]
    )
    for key_path in candidates:
        if key_path.is_file():
            text = key_path.read_text(encoding="utf-8", errors="replace").strip()
            if not re.fullmatch(r"(ssh|ecdsa|sk)-\S+ [A-Za-z0-9+/=]+( [^\n]*)?", text):
                raise FileError.of("card.no-public-key", place=key_path)
            return text
    raise FileError.of("card.no-key", valid=candidates)


def connection_file(network: Network, name: str) -> str:
    """Return the text of NetworkManager's file for this network; `name` selects the channel of a robot's network."""
    lines = [
        "[connection]",
        "id=baqueano",
        "type=wifi",
        "autoconnect=true",
        "",
        "[wifi]",
        f"ssid={_escape(network.ssid).replace(';', SSID_SEMICOLON)}",
    ]
    if network.own:
        channel = WIFI_CHANNELS[zlib.crc32(name.encode()) % len(WIFI_CHANNELS)]
        lines += ["mode=ap", "band=bg", f"channel={channel}"]
    else:
        lines += ["mode=infrastructure", "powersave=2"]  # 2: never; saving power costs 100 ms per packet
    lines += ["", "[wifi-security]", "key-mgmt=wpa-psk", f"psk={_escape(network.password)}"]
    if network.own:
        # 1: off, which the Pi's chip needs as an access point
        lines += ["proto=rsn", "pairwise=ccmp", "group=ccmp", "pmf=1"]
    shared_lines = ["method=shared", "address1=10.42.0.1/24"]
    return "\n".join(
        [
            *lines,
            "",
            "[ipv4]",
            *(shared_lines if network.own else ["method=auto"]),
            "",
            "[ipv6]",
            "method=auto",
            "",
        ]
    )


def write_card(boot: Path, name: str, user: str, key: str, network: Network | None) -> list[str]:
    """Write the first-boot files, and return a line of text for each.

    Raise UsageError for values that a Pi does not accept.
    """
    _check_inputs(name, user, network)
    script = (files("baqueano.robot") / "files" / "firstrun.sh").read_text(encoding="utf-8")
    replacements = {
        "name": name, "user": user, "key": key, "connection": connection_file(network, name) if network else "",
        "country": network.country if network else "",
    }  # fmt: skip
    placeholder_pattern = f"@({'|'.join(replacements)})@"  # all at once: a value can contain a placeholder
    script = re.sub(placeholder_pattern, lambda match: shlex.quote(replacements[match[1]]), script)
    with (boot / "firstrun.sh").open("w", encoding="utf-8", newline="\n") as file:
        file.write(script)
    lines = [_("{path}: {user}@{name}.local, by key", path=boot / "firstrun.sh", user=user, name=name)]
    line = [
        placeholder
        for placeholder in (boot / "cmdline.txt").read_text(encoding="utf-8").split()
        if placeholder not in FIRST_RUN_LINES
    ]
    if network is not None:
        line = [w for w in line if not w.startswith("cfg80211.")] + [
            f"cfg80211.ieee80211_regdom={network.country}"
        ]
    if (boot / "user-data").exists():
        previous_file = boot / "user-data.before"
        if not previous_file.exists():
            previous_file.write_bytes((boot / "user-data").read_bytes())
        (boot / "user-data").write_bytes(CLOUD_CONFIG.encode())
        lines.append(
            _(
                "{path}: starts it by cloud-init; its former text is in user-data.before",
                path=boot / "user-data",
            )
        )
    else:
        line += FIRST_RUN_LINES
        lines.append(
            _("{path}: starts it at the first boot, then the Pi restarts", path=boot / "cmdline.txt")
        )
    # \r would end the name of the last unit
    (boot / "cmdline.txt").write_bytes(f"{' '.join(line)}\n".encode())
    return lines


def _escape(text: str) -> str:
    """Return a string for a key file of GLib, with backslashes and a leading space escaped."""
    text = text.replace("\\", "\\\\")
    return "\\s" + text[1:] if text.startswith(" ") else text


def _check_inputs(name: str, user: str, network: Network | None) -> None:
    if not re.fullmatch(r"[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?", name):
        raise UsageError.of("card.name", name=name)
    if not re.fullmatch(r"[a-z][a-z0-9_-]{0,31}", user) or user == "root":
        raise UsageError.of("card.user", user=user)
    if network is None:
        return
    if not 1 <= len(network.ssid.encode()) <= 32:
        raise UsageError.of("card.network-name", bytes=len(network.ssid.encode()))
    if not re.fullmatch(r"[ -~]{8,63}", network.password):
        raise UsageError.of("card.network-password", letters=len(network.password))
    if not re.fullmatch(r"[A-Z]{2}", network.country):
        raise UsageError.of("card.country", country=network.country)
