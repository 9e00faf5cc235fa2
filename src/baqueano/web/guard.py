"""The guard of the page: it decides who connects, and to what.

    Host     one of the served addresses, with the port, on every request: a name that was rebound is none     (1)
    Origin   one of the served origins on every upgrade; none: a token decides, to watch alone                 (2)
    token    128 bits of a role, in the fragment of the address, compared in constant time;
             FAILURES a minute from an address, then none is looked at                                         (3)

A mission of a browser says what MISSIONS lists, and nothing else.

On loopback nobody needs a token; with `--share` everybody does.
"""

import hmac
import math
import secrets
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable
from enum import IntEnum
from typing import TYPE_CHECKING

from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.printable import one_line

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject

FAILURES = 5  # wrong tokens of an address
MINUTE_S = 60.0
ADDRESSES = 1024  # that are remembered
HOLDS_S = 12 * 3600.0  # a token
LOOPBACK = ("127.0.0.1", "::1")
LONGEST = 60  # letters of a name in a word
MISSIONS: "dict[str, dict[str, type]]" = {  # what a mission of a kind may say beside
    "teach": {"name": str, "shape": str, "size_m": float, "speed_m_s": float, "closed": bool},
    "repeat": {"route": str, "laps": float}, "experiment": {"seconds": float, "signal": str}, "drive": {},
    "first drive": {},
}  # fmt: skip


class Role(IntEnum):
    """The rights of a visitor: each role includes the rights of the previous one."""

    VIEW = 1
    STOP = 2
    DRIVE = 3

    @property
    def word(self) -> str:
        """Return the role as the protocol writes it."""
        return self.name.lower()


class Guard:
    """The addresses that are served, and a token for each role."""

    def __init__(
        self,
        addresses: Iterable[str],
        port: int,
        shared: bool = False,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self.shared, self._now, self._begun_s = shared, now, now()
        self.hosts = frozenset(f"{bracketed(address)}:{port}".lower() for address in addresses)
        self._origins = frozenset(f"http://{host}" for host in self.hosts)
        self.tokens = {role: secrets.token_urlsafe(16) for role in Role}
        self._failures: defaultdict[str, deque[float]] = defaultdict(deque)

    def knows_host(self, hosts: list[str]) -> bool:
        """Return True where a request names one host, and it is ours.  (1)"""
        return len(hosts) == 1 and hosts[0].lower() in self.hosts

    def knows_origin(self, origins: list[str]) -> bool:
        """Return True where an upgrade comes from a page of ours, or from no page at all.  (2)"""
        return not origins or (len(origins) == 1 and origins[0].lower() in self._origins)

    def role(self, address: str, token: str, from_page: bool) -> Role | None:
        """Return what a visitor may do; None: nothing. Without an Origin it is to watch.  (2), (3)"""
        failures = self._failures[address]
        while failures and self._now() - failures[0] > MINUTE_S:
            failures.popleft()
        if not token:
            free = from_page and not self.shared and address in LOOPBACK
            return Role.DRIVE if free else None
        if len(failures) >= FAILURES:
            return None
        candidate, matching = token.encode(), None
        for role, own_token in self.tokens.items():  # all of them: the time tells nothing
            if hmac.compare_digest(candidate, own_token.encode()):
                matching = role
        if matching is None or self._now() - self._begun_s > HOLDS_S:
            self._fail(address)
            return None
        return matching if from_page else Role.VIEW

    def _fail(self, address: str) -> None:
        if len(self._failures) > ADDRESSES:
            self._failures.clear()
        self._failures[address].append(self._now())


class Rate:
    """At most `each_s` words a second, and twice as many at once: what came while this process did not run."""

    def __init__(self, each_s: float, now: Callable[[], float] = time.monotonic) -> None:
        self._each_s, self._most, self._credit = each_s, 2.0 * each_s, 2.0 * each_s
        self._now, self._last_s = now, now()

    def one_more(self) -> bool:
        """Return True if one more is within the rate."""
        now = self._now()
        self._credit = min(self._most, self._credit + (now - self._last_s) * self._each_s)
        self._last_s = now
        if self._credit < 1.0:
            return False
        self._credit -= 1.0
        return True


def bracketed(address: str) -> str:
    """Return an address as an URL writes it.

    >>> bracketed("::1"), bracketed("192.168.4.1")
    ('[::1]', '192.168.4.1')
    """
    return f"[{address}]" if ":" in address else address


def mission_of(word: "JsonObject") -> "tuple[str, JsonObject]":
    """Return kind and options of the mission that a browser asks for. UsageError for another."""
    kind = str(word["kind"])
    if kind not in MISSIONS:
        raise UsageError(fault("web.no-such-mission", kind=one_line(kind)[:LONGEST], known=[*MISSIONS]))
    kinds = MISSIONS[kind]
    return kind, {name: _of_kind(word[name], kinds[name]) for name in kinds if name in word}


def finite(x: object) -> bool:
    """Return True for a number that is finite."""
    return isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x)


def _of_kind(value: object, kind: type) -> object:
    """Return a value of a mission as what it must be. UsageError where it is something else."""
    if kind is float and finite(value):
        return value
    if kind is str and isinstance(value, str) and len(value) <= LONGEST:
        return value
    if kind is bool and isinstance(value, bool):
        return value
    raise UsageError(fault("web.not-understood", error=one_line(repr(value))[:LONGEST]))
