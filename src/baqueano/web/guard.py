"""Guard the page: decide which browsers are allowed to connect, and with which rights.

    Host     must be a served address with the port, on every request, so that a rebound name is refused        (1)
    Origin   must be a served origin on every upgrade; without an Origin, a token only allows to view           (2)
    token    128 bits per role, in the fragment of the address, compared in constant time; after MAX_FAILURES
             wrong tokens in a minute from an address, its tokens are refused                                   (3)

Of a mission requested by a browser, only the options that MISSION_OPTIONS lists are used.

On loopback a browser does not need a token; with `--share` every browser does.
"""

import hmac
import math
import secrets
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable
from enum import IntEnum

from baqueano.contracts.values import JsonObject
from baqueano.errors import UsageError
from baqueano.messages.printable import one_line

MAX_FAILURES = 5  # maximum number of wrong tokens from an address in a minute
MINUTE_S = 60.0
MAX_ADDRESSES = 1024  # maximum number of addresses that are stored
TOKEN_LIFETIME_S = 12 * 3600.0  # lifetime of a token
LOOPBACK = ("127.0.0.1", "::1")
MAX_OPTION_LETTERS = 60  # maximum number of characters of a text option
MISSION_OPTIONS: "dict[str, dict[str, type]]" = {  # kind → the allowed options and their types
    "teach": {"name": str, "shape": str, "size_m": float, "speed_m_s": float, "closed": bool},
    "repeat": {"route": str, "laps": float}, "experiment": {"seconds": float, "signal": str}, "drive": {},
    "first drive": {},
}  # fmt: skip


class Role(IntEnum):
    """The rights of a browser: each role includes the rights of the previous role."""

    VIEW = 1
    STOP = 2
    DRIVE = 3

    @property
    def protocol_name(self) -> str:
        """Return the name of the role in the protocol."""
        return self.name.lower()


class Guard:
    """The served addresses, and a token for each role."""

    def __init__(
        self,
        addresses: Iterable[str],
        port: int,
        shared: bool = False,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self.shared, self._now, self._begun_s = shared, now, now()
        self.hosts = frozenset(f"{url_host(address)}:{port}".lower() for address in addresses)
        self._origins = frozenset(f"http://{host}" for host in self.hosts)
        self.tokens = {role: secrets.token_urlsafe(16) for role in Role}
        self._failures: defaultdict[str, deque[float]] = defaultdict(deque)

    def is_served_host(self, hosts: list[str]) -> bool:
        """Return True if a request has exactly one Host header, and it names a served host.  (1)"""
        return len(hosts) == 1 and hosts[0].lower() in self.hosts

    def is_allowed_origin(self, origins: list[str]) -> bool:
        """Return True if an upgrade is from a page of this server, or does not have an Origin header.  (2)"""
        return not origins or (len(origins) == 1 and origins[0].lower() in self._origins)

    def browser_role(self, address: str, token: str, from_page: bool) -> Role | None:
        """Return the role of a browser, None if the browser is refused.  (2), (3)

        Without an Origin the role is at most VIEW. Tokens are valid for TOKEN_LIFETIME_S after the start of the page.
        """
        failures = self._failures[address]
        while failures and self._now() - failures[0] > MINUTE_S:
            failures.popleft()
        if not token:
            needs_no_token = from_page and not self.shared and address in LOOPBACK
            return Role.DRIVE if needs_no_token else None
        if len(failures) >= MAX_FAILURES:
            return None
        candidate, matching_name = token.encode(), None
        # all of them, so that the duration does not reveal the match
        for role, own_token in self.tokens.items():
            if hmac.compare_digest(candidate, own_token.encode()):
                matching_name = role
        if matching_name is None or self._now() - self._begun_s > TOKEN_LIFETIME_S:
            self._record_failure(address)
            return None
        return matching_name if from_page else Role.VIEW

    def _record_failure(self, address: str) -> None:
        if len(self._failures) > MAX_ADDRESSES:
            self._failures.clear()
        self._failures[address].append(self._now())


class RateLimit:
    """A limit of `rate_hz` messages per second. A burst of twice as many is allowed, after a pause of this process."""

    def __init__(self, rate_hz: float, now: Callable[[], float] = time.monotonic) -> None:
        self._rate_hz, self._max_token_count, self._token_count = rate_hz, 2.0 * rate_hz, 2.0 * rate_hz
        self._now, self._last_s = now, now()

    def allows_message(self) -> bool:
        """Count one more message; return True if it is within the rate."""
        now_s = self._now()
        self._token_count = min(
            self._max_token_count, self._token_count + (now_s - self._last_s) * self._rate_hz
        )
        self._last_s = now_s
        if self._token_count < 1.0:
            return False
        self._token_count -= 1.0
        return True


def url_host(address: str) -> str:
    """Return an address in the form that a URL needs, with an IPv6 address in brackets.

    >>> url_host("::1"), url_host("192.168.4.1")
    ('[::1]', '192.168.4.1')
    """
    return f"[{address}]" if ":" in address else address


def requested_mission(request: JsonObject) -> tuple[str, JsonObject]:
    """Return the kind and the options of the mission that a browser requests.

    Unknown options are ignored. Raise UsageError for an unknown kind, or an option of the wrong type.
    """
    kind = str(request["kind"])
    if kind not in MISSION_OPTIONS:
        raise UsageError.of(
            "web.no-such-mission", kind=one_line(kind)[:MAX_OPTION_LETTERS], valid=[*MISSION_OPTIONS]
        )
    kinds = MISSION_OPTIONS[kind]
    return kind, {name: _checked_option(request[name], kinds[name]) for name in kinds if name in request}


def is_finite_number(x: object) -> bool:
    """Return True if `x` is an int or a float, but not a bool, and finite."""
    return isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x)


def _checked_option(value: object, kind: type) -> object:
    """Return an option of a mission.

    Raise UsageError for another type, a number that is not finite, or a text over MAX_OPTION_LETTERS characters.
    """
    if kind is float and is_finite_number(value):
        return value
    if kind is str and isinstance(value, str) and len(value) <= MAX_OPTION_LETTERS:
        return value
    if kind is bool and isinstance(value, bool):
        return value
    raise UsageError.of("web.not-understood", error=one_line(repr(value))[:MAX_OPTION_LETTERS])
