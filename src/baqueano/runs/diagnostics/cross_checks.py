"""Find errors that an imported recording can contain.

Each signal is checked alone (physical_limits.py), the truth alone (truth.py), then all against each other
(motion_checks.py). An error contradicts the map: the import stops and prints the correct line for the map. The import
continues if the map lists the error under `accept`.
"""

from collections.abc import Iterator

import numpy as np

from baqueano.diagnostics import Diagnostic, note
from baqueano.errors import FileError
from baqueano.runs.diagnostics.finding import ImportFinding
from baqueano.runs.diagnostics.motion_checks import motion_findings
from baqueano.runs.diagnostics.physical_limits import commands, limit_findings
from baqueano.runs.diagnostics.repeated_readings import find_repeats, is_read_too_fast
from baqueano.runs.diagnostics.truth import truth_findings
from baqueano.runs.maps.columns import ColumnMap
from baqueano.runs.run import Run

LONG_HOLD_FACTOR = 10.0  # times the median duration of a value: the vehicle is at rest


def accept_errors(findings: list[ImportFinding], m: ColumnMap) -> tuple[ImportFinding, ...]:
    """Return the findings, with accepted errors as warnings. Raise FileError if the map does not accept an error."""
    errors = [d for d in findings if d.level == "error" and d.code not in m.accept]
    if errors:
        codes = ", ".join(f'"{code}"' for code in sorted({*m.accept, *(d.code for d in errors)}))
        raise FileError.of(
            "import.does-not-fit", map=m.path.name, findings=_joined_diagnostic(errors), codes=codes
        )
    return tuple(
        d._replace(level="warning", reason=note("recording.accepted", cause=d.reason))
        if d.level == "error"
        else d
        for d in findings
    )


def _joined_diagnostic(findings: list[ImportFinding]) -> Diagnostic:
    """Return several findings as one. A map line that several findings share is printed only after the last of them."""
    lines = [d.line for d in findings]
    diagnostics = [
        note("recording.cause-and-line", cause=d.reason, line=d.line)
        if d.line and d.line not in lines[k + 1 :]
        else d.reason
        for k, d in enumerate(findings)
    ]
    first = diagnostics[0]
    for diagnostic in diagnostics[1:]:
        first = note("recording.two-sentences", first=first, second=diagnostic)
    return first


def cross_check(run: Run, m: ColumnMap) -> list[ImportFinding]:
    """Return all findings about a run."""
    findings: list[ImportFinding] = []
    for name, channel in run.sensors.items():
        findings += _channel_findings(
            f"sensors.{name}", channel.t_ns, channel.z, is_slow=m.sensors[name].kind == "battery"
        )
        findings += limit_findings(m.sensors[name], channel, run)
    findings += commands(run, m)
    if run.truth is not None:
        findings += [*_channel_findings("truth", run.truth.t_ns, run.truth.eta), *truth_findings(run.truth)]
    return findings + motion_findings(run, m)


def _channel_findings(
    key: str, t_ns: np.ndarray, z: np.ndarray, is_slow: bool = False
) -> Iterator[ImportFinding]:
    """Yield the findings about a signal whose value never changes, or repeats. If `is_slow` is True, it can repeat."""
    z = z[:, np.isfinite(z).any(axis=0)]
    if len(z) < 10 or not z.shape[1]:
        return
    constant = np.max(z, axis=0) == np.min(z, axis=0)
    for i in np.flatnonzero(constant):
        reason = note("recording.constant", key=key, number=i, value=z[0, i], rows=len(z))
        yield ImportFinding("constant", "warning", reason)
    if is_slow:
        return
    hold_counts = np.concatenate(
        [np.zeros(0, int), *(find_repeats(column).hold_counts for column in z[:, ~constant].T)]
    )
    if is_read_too_fast(hold_counts):
        mean_hold = float(np.mean(hold_counts[hold_counts < LONG_HOLD_FACTOR * np.median(hold_counts)]))
        reason = note("recording.repeated-rows", key=key, share=1.0 - 1.0 / mean_hold, period_rows=mean_hold)
        yield ImportFinding(
            "repeated samples", "warning", reason, note("recording.write-new-when"), t_ns=int(t_ns[0])
        )
