"""The address of a page: for the browser of this machine, and with `--share` for a network, as a QR code too."""

import os
import socket
import sys
import webbrowser
from contextlib import suppress

from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.web.guard import Role, bracketed

ANYWHERE = "192.0.2.1"  # of documentation: nothing is sent there, the system only says from where it would be


def own_address() -> str:
    """Return the address of this machine in its network. UsageError without one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((ANYWHERE, 9))
            address = probe.getsockname()[0]
        except OSError as error:
            raise UsageError(fault("web.no-network")) from error
    if address.startswith("127."):
        raise UsageError(fault("web.no-network"))
    return address


def own_names() -> tuple[str, ...]:
    """Return the name by which others of the network may look for this machine."""
    name = socket.gethostname().partition(".")[0]
    return (f"{name}.local",) if name else ()


def url(address: str, port: int, tokens: dict[Role, str], role: Role | None = None) -> str:
    """Return an address, with the token of a role behind #, which no browser sends."""
    return f"http://{bracketed(address)}:{port}/" + (f"#token={tokens[role]}" if role else "")


def qr_code(address: str) -> str:
    """Return a QR code in the letters of a terminal."""
    import io

    import segno

    out = io.StringIO()
    segno.make(address, error="l", micro=False).terminal(out, compact=True)
    return out.getvalue().rstrip("\n")


def display() -> bool:
    """Return True where a browser can open a tab: a screen, and nobody's CI."""
    if os.environ.get("CI"):
        return False
    return sys.platform in ("darwin", "win32") or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )


def open_tab(address: str) -> bool:
    """Open a tab where there is a display; return False without one."""
    if not display():
        return False
    with suppress(webbrowser.Error, OSError):
        return webbrowser.open(address, new=2)
    return False
