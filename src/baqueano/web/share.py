"""Make the address of a page for the browser of this machine, and for a network, with a QR code."""

import os
import socket
import sys
import webbrowser
from contextlib import suppress

from baqueano.errors import UsageError
from baqueano.messages.language import chosen_language
from baqueano.web.guard import Role, url_host

OUTSIDE_ADDRESS = "192.0.2.1"  # reserved for documentation: nothing is sent, only the local address is found


def own_address() -> str:
    """Return the address of this machine in its network. Raise UsageError without a network."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((OUTSIDE_ADDRESS, 9))
            address = probe.getsockname()[0]
        except OSError as error:
            raise UsageError.of("web.no-network") from error
    if address.startswith("127."):
        raise UsageError.of("web.no-network")
    return address


def network_names() -> tuple[str, ...]:
    """Return the names by which other machines of the network can find this machine, () without a host name."""
    name = socket.gethostname().partition(".")[0]
    return (f"{name}.local",) if name else ()


def url(address: str, port: int, tokens: dict[Role, str], role: Role | None = None) -> str:
    """Return the URL of the page, in the language of the command if it was chosen.

    The token of a role is after #: browsers do not send this part to the server.
    """
    language = chosen_language()
    page = f"http://{url_host(address)}:{port}/" + (f"?lang={language}" if language else "")
    return page + (f"#token={tokens[role]}" if role else "")


def qr_code(address: str) -> str:
    """Return the QR code of an address, drawn with characters of a terminal."""
    import io

    import segno

    buffer = io.StringIO()
    segno.make(address, error="l", micro=False).terminal(buffer, compact=True)
    return buffer.getvalue().rstrip("\n")


def has_display() -> bool:
    """Return True if a browser can open a tab: there is a display, and the process does not run in CI."""
    if os.environ.get("CI"):
        return False
    return sys.platform in ("darwin", "win32") or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )


def open_tab(address: str) -> bool:
    """Open a tab of the browser, and return True; return False without a display or a browser."""
    if not has_display():
        return False
    with suppress(webbrowser.Error, OSError):
        return webbrowser.open(address, new=2)
    return False
