"""Describe the state of a vehicle and its record of faults in sentences, in the language of the reader.

The state contains the activity of the vehicle, its accuracy, and unusual events. The record contains the faults, and
the checks that detected them.
"""

import math
from contextlib import suppress
from typing import TYPE_CHECKING

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.messages import list_item, text, with_full_stop

if TYPE_CHECKING:
    from baqueano.web.feed import Feed

MISSION_TITLES = {
    "teach": "web.title-teach", "repeat": "web.title-repeat", "drive": "web.title-drive",
    "experiment": "web.title-experiment", "first drive": "web.title-first-drive",
}  # fmt: skip
STATE_TEXTS = {
    "READY": "web.title-ready", "STOPPED": "web.title-stopped", "DISARMED": "web.title-disarmed",
    "OVER": "web.title-over",
}  # fmt: skip
NIS_WINDOW_S = 10.0
MIN_NIS_COUNT = 100  # least number of NIS values for a sentence
COPIED_FIELDS = ("number", "t_s", "until_s", "ended", "fault")  # copied fields of a row of `ledger`
HALF_BAND = 1.96 * math.sqrt(2.0)  # 95 % half width of the mean of N squared normal variables, times √N


def state_message(
    state: JsonObject, feed: "Feed", route: JsonObject | None, warnings: list[Diagnostic]
) -> JsonObject:
    """Return the message `state` for a browser, in the current language; `warnings` are the present ones."""
    kind, name = state.get("mission"), state["state"]
    is_driving = kind is not None and name in ("MISSION", "MANUAL")
    lap, laps = _lap_number(feed, route), state.get("laps")
    title = (
        MISSION_TITLES.get(str(kind), "web.title-drive")
        if is_driving
        else STATE_TEXTS.get(name, "web.title-ready")
    )
    title = "web.title-prepares" if name == "READY" and "step" in state else title
    title = "web.title-paused" if state.get("paused") and is_driving else title
    parts = _drive_sentences(state, feed, lap, laps) if is_driving else [_cause_sentence(state)]
    severity = Severity.ERROR if name == "STOPPED" else Severity.WARNING if warnings else Severity.INFO
    route_field = {} if not route or not route.get("name") else {"route": route["name"]}
    return {
        "type": "state", "state": name, "mission": {"kind": kind, **route_field} if is_driving else None,
        "lap": lap if is_driving else None, "laps": laps, "left_s": state.get("left_s"), "t_s": state.get("t_s"),
        "paused": state.get("paused") if is_driving else None, "pace": state.get("pace"), "title": text(note(title)),
        "sentence": " ".join(with_full_stop(text(part)) for part in parts), "severity": str(severity),
        "warnings": [list_item(text(message)) for message in warnings], "battery_v": state.get("battery_v"),
        "scene": state.get("scene"),
    }  # fmt: skip


def _cause_sentence(state: JsonObject) -> Diagnostic:
    cause = state.get("reason")
    if state["state"] == "STOPPED":
        return note("web.stopped", cause=cause or "")
    if state["state"] == "OVER" and isinstance(cause, Diagnostic):
        return cause
    if state["state"] == "DISARMED":
        return note("web.disarmed", cause=cause or "")
    step = state.get("step")  # of the work before the drives of a demo
    return step if isinstance(step, Diagnostic) else note("web.ready")


def _drive_sentences(state: JsonObject, feed: "Feed", lap: int | None, laps: object) -> list[Diagnostic]:
    """Return the sentences about the activity of a driving vehicle and about its accuracy."""
    if rest_s := state.get("rest_s"):
        return [note("web.rest", rest_s=rest_s)]
    parts: list[Diagnostic] = []
    if state.get("mission") == "repeat" and lap is not None:
        parts.append(note("web.lap-of", lap=lap, laps=laps) if laps else note("web.lap", lap=lap))
    cross = feed.value("cross")
    if state.get("mission") in ("repeat", "teach") and math.isfinite(cross):
        parts.append(note("web.from-route", cm=100.0 * abs(cross)))
    elif math.isfinite(speed := feed.value("nu.u")):
        parts.append(note("web.speed", speed_m_s=round(speed, 2) + 0.0))  # not -0.0
    mean, count = feed.mean("nis", NIS_WINDOW_S)
    if count >= MIN_NIS_COUNT:
        half_band = HALF_BAND / math.sqrt(count)
        code = "web.filter-too-sure" if mean > 1.0 + half_band else "web.filter-fits"
        parts.append(note("web.filter-cautious" if mean < 1.0 - half_band else code, nis=mean))
    return parts or [note("web.begins")]


def _lap_number(feed: "Feed", route: JsonObject | None) -> int | None:
    """Return the number of the lap, from 1 on, from the progress along the route; None if it is unknown."""
    length_m, progress = (route or {}).get("length_m") or 0.0, feed.value("progress")
    if not (length_m > 0.0 and math.isfinite(progress)):
        return None
    return max(1, math.floor(progress / length_m) + 1)


def ledger_rows(rows: list[JsonObject]) -> list[JsonObject]:
    """Return the rows of the door's message `ledger`, with texts instead of diagnostics."""
    return [
        {name: row.get(name) for name in COPIED_FIELDS}
        | {
            "text": _text(row.get("message")), "undetected": _text(row.get("undetected")),
            "detections": [
                {"detector": _text(notice.get("detector")), "after_s": notice.get("after_s"),
                 "text": _text(notice.get("message"))}
                for notice in row.get("detections") or [] if isinstance(notice, dict)
            ],
            "missed_by": [_text(source) for source in row.get("missed_by") or []],
        }
        for row in rows
    ]  # fmt: skip


def _text(message: object) -> str | None:
    with suppress(ValueError):
        return text(Diagnostic.from_json(message)) if message is not None else None
    return None
