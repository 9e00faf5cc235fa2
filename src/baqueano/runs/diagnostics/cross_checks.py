"""Find errors that an imported recording may contain.

Each signal is checked by itself (physical_limits.py), the truth by itself (truth.py), then all against each other
(by_motion.py). An error contradicts the map: the import stops and prints the correct line for the map. The import
continues if the map lists the error under `accept`.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from baqueano.diagnostics import Diagnostic, fault, note
from baqueano.errors import FileError
from baqueano.runs.diagnostics.by_motion import by_motion
from baqueano.runs.diagnostics.finding import ImportFinding
from baqueano.runs.diagnostics.physical_limits import commands, plausible
from baqueano.runs.diagnostics.repeated_readings import are_held, repeats
from baqueano.runs.diagnostics.truth import course_and_heading
from baqueano.runs.run import Run

if TYPE_CHECKING:
    from baqueano.runs.maps.columns import ColumnMap

LONG = 10.0  # times the median duration of a value: the vehicle is at rest


def accept_errors(findings: list[ImportFinding], m: "ColumnMap") -> tuple[ImportFinding, ...]:
    """Return the findings, with accepted errors as warnings. Raise FileError if the map does not accept an error."""
    errors = [d for d in findings if d.level == "error" and d.code not in m.accept]
    if errors:
        codes = ", ".join(f'"{code}"' for code in sorted({*m.accept, *(d.code for d in errors)}))
        raise FileError(fault("import.does-not-fit", map=m.path.name, findings=_all(errors), accept=codes))
    return tuple(
        d._replace(level="warning", reason=note("recording.accepted", cause=d.reason))
        if d.level == "error"
        else d
        for d in findings
    )


def _all(findings: list[ImportFinding]) -> Diagnostic:
    """Return several findings as one. A map line that several findings share is printed only after the last of them."""
    lines = [d.line for d in findings]
    each = [
        note("recording.and-line", cause=d.reason, line=d.line)
        if d.line and d.line not in lines[k + 1 :]
        else d.reason
        for k, d in enumerate(findings)
    ]
    first = each[0]
    for then in each[1:]:
        first = note("recording.then", first=first, then=then)
    return first


def look(run: Run, m: "ColumnMap") -> list[ImportFinding]:
    """Return all findings about a run."""
    findings: list[ImportFinding] = []
    for name, channel in run.sensors.items():
        findings += _channel_findings(
            f"sensors.{name}", channel.t_ns, channel.z, slow=m.sensors[name].kind == "battery"
        )
        findings += plausible(m.sensors[name], channel, run)
    findings += commands(run, m)
    if run.truth is not None:
        findings += [
            *_channel_findings("truth", run.truth.t_ns, run.truth.eta),
            *course_and_heading(run.truth),
        ]
    return findings + by_motion(run, m)


def _channel_findings(
    key: str, t_ns: np.ndarray, z: np.ndarray, slow: bool = False
) -> Iterator[ImportFinding]:
    """Yield the findings about a signal whose value never changes, or repeats. A `slow` signal may repeat its
    values."""
    z = z[:, np.isfinite(z).any(axis=0)]
    if len(z) < 10 or not z.shape[1]:
        return
    constant = np.ptp(z, axis=0) == 0.0
    for i in np.flatnonzero(constant):
        reason = note("recording.constant", key=key, number=i, value=z[0, i], rows=len(z))
        yield ImportFinding("constant", "warning", None, reason)
    if slow:
        return
    lasting = np.concatenate([np.zeros(0, int), *(repeats(column).lasting for column in z[:, ~constant].T)])
    if are_held(lasting):
        every = float(np.mean(lasting[lasting < LONG * np.median(lasting)]))
        reason = note("recording.held", key=key, share=1.0 - 1.0 / every, every=every)
        yield ImportFinding(
            "repeated samples", "warning", int(t_ns[0]), reason, note("recording.write-new-when")
        )
