"""Exclude readings of a speed without a sign while the direction of the vehicle is unknown.

A Hall sensor or a GPS measures |v|. A command backward brakes first and then reverses, and after it the vehicle rolls
backward until it stops. So the direction is unknown from a command backward until

    z < REST_SHARE z_max, without a command backward,   or                                                (1)
    z > z_min + RISE_SHARE z_max, under a command forward                                                 (2)

z is the reading, z_max the largest one, and z_min the least one since the last command forward began. Under such a
command a vehicle that rolls backward becomes slower, and one that moves forward becomes faster.
"""

from dataclasses import replace

import numpy as np

from baqueano.diagnostics import note
from baqueano.runs.diagnostics.finding import ImportFinding
from baqueano.runs.diagnostics.motion_checks import names_steering
from baqueano.runs.logs import log_rows
from baqueano.runs.maps.columns import ColumnMap
from baqueano.runs.run import Run

NO_SIGN, SIGN_MISSING, EXCLUDED = "no sign", "recording.no-sign", "recording.no-sign-excluded"
REST_SHARE, RISE_SHARE = 0.02, 0.1
MIN_COMMAND_SHARE = 0.02  # of the largest command: a smaller one does not move the vehicle


def without_unknown_direction(
    run: Run, m: ColumnMap, findings: list[ImportFinding]
) -> tuple[Run, list[ImportFinding]]:
    """Return the run, and the findings. If a finding states that an odometer lacks the sign, its readings in an unknown
    direction are excluded and counted. A map that accepts "no sign" keeps all readings.
    """
    key_name = {s.entries[0].key: name for name, s in m.sensors.items() if s.kind == "odometer"}
    if NO_SIGN in m.accept:
        return run, findings
    excluded_keys = {_key(finding) for finding in findings if finding.reason.code == EXCLUDED}
    sensors, results = dict(run.sensors), []
    for finding in findings:
        if (key := _key(finding)) not in key_name or finding.reason.code == EXCLUDED:
            results.append(finding)
        elif key not in excluded_keys:
            excluded_keys.add(key)
            channel = sensors[key_name[key]]
            is_forward = forward_readings(channel.t_ns, channel.z[:, 0], run.t_ns, _forward_command(run, m))
            sensors[key_name[key]] = log_rows(channel, is_forward)
            reason = note(EXCLUDED, key=key, count=np.count_nonzero(~is_forward), rows=len(is_forward))
            exclusion = ImportFinding(NO_SIGN, "warning", reason, note("recording.log-sign"))
            results.append(finding if is_forward.all() else exclusion)
    return replace(run, sensors=sensors), results


def _key(finding: ImportFinding) -> str:
    """Return the key of the map whose speed lacks its sign by a finding, "" for another finding."""
    return str(finding.reason.figures["key"]) if finding.reason.code in (SIGN_MISSING, EXCLUDED) else ""


def unsigned_speeds(findings: list[ImportFinding]) -> list[ImportFinding]:
    """Return a finding for each speed that lacks the sign in one of several runs: it is the same sensor in all runs."""
    keys = {_key(finding) for finding in findings if finding.reason.code == EXCLUDED}
    return [ImportFinding(NO_SIGN, "info", note(SIGN_MISSING, key=key)) for key in sorted(keys)]


def forward_readings(t_ns: np.ndarray, z: np.ndarray, u_ns: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return a mask (M,) of the readings z (M,) at `t_ns` at which the vehicle moves forward or is at rest.  (1), (2)

    u (N,) are the commands of the intervals that end at `u_ns`; positive is forward.
    """
    max_speed = float(np.nanmax(z, initial=0.0))
    min_u = MIN_COMMAND_SHARE * float(np.max(np.abs(u), initial=0.0))
    ends = np.minimum(np.searchsorted(u_ns, t_ns, side="left"), len(u) - 1)
    is_forward, is_known, min_speed, begin = np.zeros(len(z), dtype=bool), True, np.inf, 0
    for i, (speed, end) in enumerate(zip(z.tolist(), ends.tolist(), strict=True)):
        interval_commands = u[begin : end + 1]
        begin = end
        if np.any(interval_commands < -min_u):
            is_known, min_speed = False, np.inf
        elif not is_known:
            min_speed = min(min_speed, speed) if u[end] > min_u else np.inf
            is_known = speed < REST_SHARE * max_speed or speed > min_speed + RISE_SHARE * max_speed
        is_forward[i] = is_known
    return is_forward


def _forward_command(run: Run, m: ColumnMap) -> np.ndarray:
    """Return the command (N,) that drives the vehicle: the first one that does not steer."""
    return run.applied_commands[:, [names_steering(name) for name in m.names].index(False)]
