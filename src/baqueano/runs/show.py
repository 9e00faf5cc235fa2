"""Show the content of a run: topics, counts, rates, gaps, events.

rate = (N − 1) / (t_N − t_1),   a gap is a step longer than 1.8 times the median step                  (1)
"""

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.result import shorten
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Diagnostic
from baqueano.messages import texts
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.notation import current_notation
from baqueano.messages.printable import join_rows
from baqueano.messages.text_table import text_table
from baqueano.runs.logs import LEVELS
from baqueano.signals import NANOSECONDS

if TYPE_CHECKING:
    from baqueano.runs.run import Run

GAP_STEPS = 1.8
COMMAND_TITLES = {
    "applied": N_("command applied"), "requested": N_("command requested"), "sent": N_("command sent"),
}  # fmt: skip
MAX_SHOWN_EVENTS = 20
EVENT_INDENT = 10  # letters before the second line of an event in the table
SHOWN_KEYS = {  # of the metadata, as they are shown
    "kind": N_("recorded by"), "seed": N_("seed"), "backend": N_("back end"),
    "verdict": N_("verdict"), "laps": N_("laps"), "recovered_from": N_("recovered from"), "map": N_("map"),
    "commands": N_("commands"), "files": N_("files"), "means": N_("means over an interval"),
    "signal": N_("signal"), "route": N_("route"), "start": N_("start [m, rad]"),
    "note": N_("note"), "created": N_("created"),
    "machine": N_("machine"), "rate_hz": N_("rate [Hz]"), "noise": N_("noise"),
    "rest_s": N_("rest before the drive [s]"),
}  # fmt: skip
SHOWN_SOURCES = {  # of events, whose names are also those of commands, blocks and verdicts
    "drive": N_("this drive"), "refused": N_("rejected readings"), "sensors": N_("sensors"), "loop": N_("control loop"),
    "clock": N_("clock"), "line": N_("serial line"), "mark": N_("lap mark"), "shake": N_("simulated fault"),
    "run writer": N_("run file"),
}  # fmt: skip
NUMBERS = ("start", "rest_s")  # of the metadata


def _with_few_digits(value: str) -> str:
    """Return numbers of the metadata with four decimals in the current language; the metadata contain all digits."""
    return re.sub(
        r"-?\d+(\.\d+)?(e-?\d+)?", lambda digits: f"{number(round(float(digits[0]), 4) + 0.0):.6g}", value
    )


@dataclass(frozen=True, slots=True, eq=False)
class ShownRun:
    """The result of `runs show`."""

    run: "Run"

    @property
    def verdict(self) -> str:
        """Return WARN if the file was cut or damaged, else USABLE."""
        return "WARN" if self.run.notes else "USABLE"

    def rows(self) -> list[TableRow]:
        """Return a flat dict per topic; an unknown value is None."""
        run = self.run
        start = run.start_ns
        rows = [_row(COMMAND_TITLES[stage], run.t_ns, u, start) for stage, u in run.commands.items()]
        for name, channel in run.sensors.items():
            row = _row(f"sensor {name}", channel.t_ns, channel.z, start)
            late_ns = channel.arrival_ns - channel.t_ns
            row["delay_ms"] = float(np.median(late_ns)) * 1e-6 if len(late_ns) else None
            rows.append(row)
        for name in ("estimate", "reference", "truth"):
            log = getattr(run, name)
            if log is not None:
                rows.append(_row(name, log.t_ns, log.eta, start))
        return rows

    def table(self, *, is_sorted: bool = False) -> str:
        """Return the topics, the events by time or the most severe first, and the notes on the file, as text."""
        run, ticks = self.run, len(self.run.t_ns)
        head = _(
            "{run}: {ticks} ticks, {duration_s:.2f} s.", run=run.name, ticks=ticks, duration_s=run.duration_s
        )
        counts = " ".join(
            f"{_(SHOWN_KEYS.get(key, key))}: {_with_few_digits(value) if key in NUMBERS else _(value)};"
            for key, value in run.metadata.items()
            if "\n" not in value and value
        )
        notes = (_("note: {note}", note=line) for line in texts(run.notes))
        lines = [
            f"{head} {counts.rstrip(';')}",
            *self._topic_table(),
            *self._event_table(is_sorted=is_sorted),
        ]
        return join_rows([*lines, *notes])

    def _topic_table(self) -> list[str]:
        cells = []
        for r in self.rows():
            rate = "" if r["rate_hz"] is None else f"{number(r['rate_hz']):.2f} Hz"
            longest_text = "" if r["longest_step_s"] is None else f"{number(r['longest_step_s']):.4f} s"
            delay = "" if r.get("delay_ms") is None else f"{number(r['delay_ms']):.1f} ms"
            row_counts = str(r["count"]), rate, str(r["gaps"]), longest_text, str(r["nan_rows"]), delay
            cells.append([_topic(r["topic"]), *row_counts, str(r["size"])])
        names = _("topic"), _("count"), _("rate"), _("gaps"), _("longest step"), "NaN", _("delay"), _("size")
        return text_table("<>>>>>><", list(names), *cells)

    def _event_table(self, *, is_sorted: bool) -> list[str]:
        """Return at most MAX_SHOWN_EVENTS events, by time or the most severe first, and the number of the others."""
        events, start, count = list(self.run.events), self.run.start_ns, len(self.run.events)
        if is_sorted:
            events.sort(key=lambda event: (*LEVELS, event.level).index(event.level), reverse=True)
        lines = text_table("><<", *(
            [_event_time((event.t_ns - start) / NANOSECONDS), _(event.level),
             f"{_(SHOWN_SOURCES.get(event.source, event.source))}: {event.sentence}"]
            for event in events[:MAX_SHOWN_EVENTS]
        ))  # fmt: skip
        if count <= MAX_SHOWN_EVENTS:
            return lines
        command = current_notation().command("--json")
        remark = _(
            "and {more} more events. To list all: {command}", more=count - MAX_SHOWN_EVENTS, command=command
        )
        return [*lines, remark]

    def events(self) -> list[TableRow]:
        """Return all events as flat dicts, times in seconds since the first tick."""
        start = self.run.start_ns
        return [
            {
                "t_s": (e.t_ns - start) / NANOSECONDS,
                "level": e.level,
                "source": e.source,
                "text": e.sentence,
                **_data(e.diagnostic),
            }
            for e in self.run.events
        ]


def _event_time(t_s: float) -> str:
    """Return the time since the first tick as text; "start" for an event of the preparation before it."""
    return f"{number(t_s):.3f} s" if t_s >= 0.0 else _("start")


def _topic(name: str) -> str:
    """Return the name of a topic for display; sensor names are not translated."""
    stage, _space, sensor = name.partition(" ")
    return f"{_(stage)} {sensor}" if stage == N_("sensor") else _(name)


def short_text(run: "Run", *head: str) -> str:
    """Return the text that `print` shows: `head`, the topics, and the events, errors first."""
    lines = show(run).table(is_sorted=True).splitlines()
    topics = len(run.rows()) + 2  # the name, the head of the columns
    events, count = lines[topics:], 0
    if any(event.level == "error" for event in run.events):
        is_further = [line[:EVENT_INDENT].isspace() for line in events[1:]]
        count = 1 + (is_further.index(False) if False in is_further else len(is_further))
    return shorten([*head, lines[0], *events[:count]], [*lines[1:topics], *events[count:]], [])


def show(run: "Run") -> ShownRun:
    """Return the content of a run, for display or as rows."""
    return ShownRun(run)


def _data(lines: Diagnostic | None) -> JsonObject:
    if lines is None:
        return {"code": None, "figures": {}}
    return {"code": str(lines.code), "figures": dict(lines.figures)}


def _row(topic: str, t_ns: np.ndarray, values: np.ndarray, start: int) -> JsonObject:
    step_s = np.diff(t_ns) / NANOSECONDS
    usual_s = float(np.median(step_s)) if len(step_s) else 0.0
    gap_rows = np.flatnonzero(step_s > GAP_STEPS * usual_s) if usual_s > 0.0 else np.zeros(0, dtype=int)
    span = float(step_s.sum())
    return {
        "topic": topic,
        "count": len(t_ns),
        "size": values.shape[1],
        "rate_hz": (len(t_ns) - 1) / span if span > 0.0 else None,
        "gaps": len(gap_rows),
        "longest_step_s": float(step_s.max()) if len(step_s) else None,
        "first_gap_s": float((t_ns[gap_rows[0]] - start) / NANOSECONDS) if len(gap_rows) else None,
        "nan_rows": int(np.count_nonzero(np.isnan(values).any(axis=1))),
    }
