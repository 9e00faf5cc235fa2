"""Read dates and times of day as nanoseconds since 1970: ISO 8601, and the formats of loggers and spreadsheets.

    2026-05-03T14:01:12.250-03:00   2026-05-03 14:01:12,250   03/05/2026 14:01:12   5/3/2026 2:01:12 PM   14:01:12.25

A time without a zone is in UTC, and a time of day belongs to 1970-01-01. Midnight begins the next day. In 03/05/2026
the day is first, unless a date of the column shows the opposite, or the hours have AM and PM.
"""

import re
from collections.abc import Iterable, Sequence
from datetime import date

import numpy as np

from baqueano.runs.tables.table import MISSING_TEXTS
from baqueano.signals import NANOSECONDS

DAY_S = 86_400
HALF_DAY_NS = DAY_S // 2 * NANOSECONDS
NO_TIME_NS = int(np.datetime64("NaT", "ns").astype(np.int64))
FIRST_DAY = date(1970, 1, 1).toordinal()
_TIME = re.compile(
    r"(?:(?P<year>\d{4})[-/.](?P<month>\d\d?)[-/.](?P<day>\d\d?)"
    r"|(?P<first>\d\d?)[-/.](?P<second>\d\d?)[-/.](?P<last>\d{4}))?"
    r"[T\s_,]*(?:(?P<hour>\d\d?):(?P<min>\d\d)(?::(?P<s>\d\d)(?:[.,](?P<part>\d{1,12}))?)?)?"
    r"\s*(?P<half>[ap]\.?\s?m\.?)?\s*(?:Z|UTC|(?P<sign>[+-])(?P<zone_h>\d\d):?(?P<zone_min>\d\d)?)?",
    re.IGNORECASE,
)


def parse_dates(cells: Iterable[str]) -> np.ndarray:
    """Return the times (rows,) int64 [ns] of dates or times of day, NO_TIME_NS for an empty cell.
    Raise ValueError for another text.

    >>> parse_dates(["23:59:59.5", "", "00:00:00.25"]).tolist()[::2]
    [86399500000000, 86400250000000]
    """
    matches = [None if cell.lower() in MISSING_TEXTS else _match(cell) for cell in cells]
    parts = [match for match in matches if match]
    is_day_first = _is_day_first(parts)
    t_ns = np.array(
        [_match_ns(match, is_day_first) if match else NO_TIME_NS for match in matches], dtype=np.int64
    )
    if parts and all(_has_no_date(match) for match in parts):
        rows = np.flatnonzero(t_ns != NO_TIME_NS)
        t_ns[rows[1:]] += DAY_S * NANOSECONDS * np.cumsum(np.diff(t_ns[rows]) < -HALF_DAY_NS)
    return t_ns


def _match(cell: str) -> "re.Match[str]":
    match = _TIME.fullmatch(cell.strip())
    if match is None or (_has_no_date(match) and match["hour"] is None):
        raise ValueError(cell)
    return match


def _has_no_date(match: "re.Match[str]") -> bool:
    return match["year"] is None and match["last"] is None


def _is_day_first(matches: "Sequence[re.Match[str]]") -> bool:
    """Return True if 03/05/2026 is in May: if a first number is above 12, or no second one and no AM or PM."""
    ambiguous = [match for match in matches if match["last"]]
    if any(int(match["first"]) > 12 for match in ambiguous):
        return True
    return not any(int(match["second"]) > 12 or match["half"] for match in ambiguous)


def _match_ns(match: "re.Match[str]", is_day_first: bool) -> int:
    """Return the nanoseconds since 1970. Raise ValueError for a day or an hour that does not exist."""
    day = FIRST_DAY
    if match["year"]:
        day = date(int(match["year"]), int(match["month"]), int(match["day"])).toordinal()
    elif match["last"]:
        numbers = int(match["first"]), int(match["second"])
        day_of_month, month = numbers if is_day_first else numbers[::-1]
        day = date(int(match["last"]), month, day_of_month).toordinal()
    hour, minute, s = (int(match[name] or 0) for name in ("hour", "min", "s"))
    if match["half"]:
        hour = hour % 12 + (12 if match["half"].lower().startswith("p") else 0)
    if hour > 23 or minute > 59 or s > 60:
        raise ValueError(match[0])
    ahead_min = (
        int(f"{match['sign']}{60 * int(match['zone_h']) + int(match['zone_min'] or 0)}")
        if match["sign"]
        else 0
    )
    total_s = (day - FIRST_DAY) * DAY_S + 3600 * hour + 60 * (minute - ahead_min) + s
    return total_s * NANOSECONDS + int((match["part"] or "0").ljust(9, "0")[:9])
