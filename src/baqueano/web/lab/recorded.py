"""Convert a recorded run for the page to rows of float32, one per tick, and a description of the run.

cross      −(x − x_r) sin ψ_r + (y − y_r) cos ψ_r: offset of the estimate to the left of its reference   (1)
progress   Σ |Δp_r|: the path length of the reference so far                                             (2)
nis        yᵀ S⁻¹ y / m of the m innovations y that arrived                                              (3)
"""

import tomllib
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TypeAlias

import numpy as np

from baqueano.compare.consistency import normalised_squared_error, whiten
from baqueano.contracts.values import JsonObject
from baqueano.runs.interpolation import interpolate_poses, interpolate_rows
from baqueano.runs.run import EstimateLog, ReferenceLog, Run, TruthLog
from baqueano.signals import NANOSECONDS

Log: TypeAlias = EstimateLog | ReferenceLog | TruthLog
MAX_ROUTE_POINTS = 2000  # maximum number of points of a drawn path
MAX_CLOSED_GAP_M = 0.3  # largest gap between the ends of a closed path
# default if the file does not have a body
DEFAULT_FOOTPRINT = {"kind": "round", "length_m": 0.14, "width_m": 0.14}
ETA, NU, P = ("x", "y", "psi"), ("u", "v", "r"), {"xx": (0, 0), "xy": (0, 1), "yy": (1, 1), "psi": (2, 2)}
UNITS = {
    "eta.x": "m", "eta.y": "m", "eta.psi": "rad", "nu.u": "m/s", "nu.v": "m/s", "nu.r": "rad/s",
    "P.xx": "m²", "P.xy": "m²", "P.yy": "m²", "P.psi": "rad²", "t": "s", "ref.u": "m/s",
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class PackedRun:
    """A run as columns and rows, ready to be sent."""

    fields: list[JsonObject]  # name, unit and group of each column
    t_s: np.ndarray  # (N,) since the first tick
    columns: np.ndarray  # (N, F) float32
    description: JsonObject  # name, vehicle, blocks, route, events

    def frame(self, number: int, first: int, count: int) -> bytes:
        """Return up to `count` rows from row `first` on, as a binary frame (feed.py)."""
        rows = self.columns[first : first + count]
        t0 = float(self.t_s[first]) if first < len(self.t_s) else 0.0
        head = np.array([number, len(rows)], "<u4").tobytes() + np.array([t0], "<f8").tobytes()
        return head + rows.astype("<f4", copy=False).tobytes()


def pack_run(run: Run, kinds: dict[str, str] | None = None) -> PackedRun:
    """Return a run as rows. `kinds` maps roles to the default kinds, which are used if the file does not name one."""
    columns = _columns(run)
    data = _tables(run.vehicle_text)
    names, unit = _command_names(data, run.applied_commands.shape[1])
    fields = [{"name": name, **_field_description(name, names, unit)} for name in columns]
    events = [
        {"t": (e.t_ns - int(run.t_ns[0])) / NANOSECONDS, "severity": e.level, "source": e.source,
         "text": e.text if e.diagnostic is None else e.diagnostic.to_json()}
        for e in run.events if e.source != "refused"
    ]  # fmt: skip
    context = {
        "name": run.name, "kind": run.metadata.get("kind", ""), "rows": len(run.t_ns), "seconds": run.duration_s,
        "vehicle": vehicle_description(data, len(names)), "blocks": _blocks(data, kinds or {}),
        "route": route_description(run),
        "events": events,
    }  # fmt: skip
    x = (
        np.column_stack([*columns.values()]).astype(np.float32)
        if len(run.t_ns)
        else np.zeros((0, len(fields)))
    )
    return PackedRun(fields, run.t_s, np.ascontiguousarray(x, np.float32), context)


def _columns(run: Run) -> dict[str, np.ndarray]:
    """Return the columns of a run by name, each (N,)."""
    t, n = run.t_ns, len(run.t_ns)
    silent_row = np.full(n, np.nan)
    columns: dict[str, np.ndarray] = {"t": run.t_s}
    log = run.estimate
    eta, nu, cov = _tick_poses(log, t), _tick_velocities(log, t), None
    if log is not None and len(log.t_ns):
        cov = interpolate_rows(t, log.t_ns, log.cov.reshape(len(log.t_ns), -1)).reshape(n, 6, 6)
    columns |= {f"eta.{a}": eta[:, k] for k, a in enumerate(ETA)}
    columns |= {f"P.{a}": silent_row if cov is None else cov[:, i, j] for a, (i, j) in P.items()}
    columns |= {f"nu.{a}": nu[:, k] for k, a in enumerate(NU)}
    target = run.guide_reference
    ref = _tick_poses(target, t)
    columns |= {f"ref.{a}": ref[:, k] for k, a in enumerate(ETA)} | {
        "ref.u": _tick_velocities(target, t)[:, 0]
    }
    truth = _tick_poses(run.truth, t)
    columns |= {f"truth.{a}": truth[:, k] for k, a in enumerate(ETA)}
    for k in range(run.applied_commands.shape[1]):
        columns[f"u.{k}"] = run.applied_commands[:, k]
        columns[f"requested.{k}"] = (
            silent_row if run.requested_commands is None else run.requested_commands[:, k]
        )
    columns |= _sensor_columns(run)
    offset = eta[:, :2] - ref[:, :2]
    columns["cross"] = -offset[:, 0] * np.sin(ref[:, 2]) + offset[:, 1] * np.cos(ref[:, 2])  # (1)
    steps = np.hypot(*np.diff(ref[:, :2], axis=0, prepend=ref[:1, :2]).T)
    columns["progress"] = np.where(np.isnan(ref[:, 0]), np.nan, np.nancumsum(steps))  # (2)
    return columns


def _tick_poses(log: Log | None, t_ns: np.ndarray) -> np.ndarray:
    """Return the poses (N, 3) of a log at the ticks, all NaN without a log."""
    if log is None or not len(log.t_ns):
        return np.full((len(t_ns), 3), np.nan)
    return interpolate_poses(t_ns, log.t_ns, log.eta)


def _tick_velocities(log: Log | None, t_ns: np.ndarray) -> np.ndarray:
    if log is None or not len(log.t_ns):
        return np.full((len(t_ns), 3), np.nan)
    return interpolate_rows(t_ns, log.t_ns, log.nu)


def _sensor_columns(run: Run) -> dict[str, np.ndarray]:
    """Return the columns of the sensor channels: reading, prediction, innovation and its std; and the NIS."""
    n = len(run.t_ns)
    names = [f"{name}[{k}]" for name, channel in run.sensors.items() for k in range(channel.z.shape[1])]
    z = np.full((n, len(names)), np.nan)
    offset = 0
    for channel in run.sensors.values():
        newest_index = np.searchsorted(channel.arrival_ns, run.t_ns, side="right") - 1
        is_new = np.diff(newest_index, prepend=-1) > 0
        m = channel.z.shape[1]
        z[is_new, offset : offset + m] = channel.z[newest_index[is_new]]
        offset += m
    columns = {f"z.{name}": z[:, k] for k, name in enumerate(names)}
    log = run.estimate
    if log is None or log.innovation is None or log.innovation.shape[1] != len(names) or len(log.t_ns) != n:
        return columns | {"nis": np.full(n, np.nan)}
    y, S = log.innovation, log.innovation_cov
    columns |= {f"model.{name}": z[:, k] - y[:, k] for k, name in enumerate(names)}
    columns |= {f"innov.{name}": y[:, k] for k, name in enumerate(names)}
    if S is None:
        return columns | {"nis": np.full(n, np.nan)}
    columns |= {f"S.{name}": np.sqrt(np.maximum(S[:, k, k], 0.0)) for k, name in enumerate(names)}
    w = whiten(y, S)
    count = np.sum(np.isfinite(w), axis=1)
    return columns | {"nis": normalised_squared_error(w) / np.maximum(count, 1)}  # (3)


def _field_description(name: str, commands: list[str], unit: str) -> JsonObject:
    """Return {unit, group} of a column; columns of one group share a plot."""
    prefix, _, remainder = name.partition(".")
    if prefix in ("u", "requested"):
        return {"unit": unit, "group": commands[int(remainder)]}
    if prefix in ("z", "model", "innov", "S"):
        return {"unit": _reading_unit(remainder), "group": remainder.partition("[")[0]}
    similar_name = name.replace("truth.", "eta.").replace("ref.", "eta.") if name != "ref.u" else name
    units = {"progress": "m", "cross": "m"}
    return {
        "unit": UNITS.get(similar_name, units.get(name, "")),
        "group": "route" if name in units else prefix,
    }


def _reading_unit(channel: str) -> str:
    """Return the unit of an IMU channel, or "" for the channels of other sensors."""
    return {"imu[0]": "m/s²", "imu[1]": "m/s²", "imu[2]": "rad/s"}.get(channel, "")


def _tables(vehicle_text: str) -> JsonObject:
    """Return the tables of a vehicle file, without importing the classes that it names; {} if it is not TOML."""
    try:
        return tomllib.loads(vehicle_text)
    except (tomllib.TOMLDecodeError, RecursionError):
        return {}


def _table(data: JsonObject, name: str) -> JsonObject:
    table = data.get(name)
    return table if isinstance(table, dict) else {}


def _command_names(data: JsonObject, n: int) -> tuple[list[str], str]:
    command = _table(data, "command")
    names, unit = command.get("names"), str(command.get("unit", ""))
    if isinstance(names, list) and len(names) == n:
        return [str(name) for name in names], unit
    return [f"u[{k}]" for k in range(n)], unit


def vehicle_description(data: JsonObject, n: int, world: str = "recorded") -> JsonObject:
    """Return the description of a vehicle with `n` commands for the page, from the tables of its file."""
    names, unit = _command_names(data, n)
    limit = _table(data, "command").get("limit")
    limits = limit if isinstance(limit, list) and len(limit) == n else [1.0] * n
    return {
        "name": str(data.get("name", "")), "footprint": _footprint(_table(data, "geometry")),
        "command": [
            {"name": name, "low": -_number(high), "high": _number(high), "unit": unit}
            for name, high in zip(names, limits, strict=True)
        ],
        "rate_hz": _number(data.get("rate_hz", 0.0)), "world": world,
    }  # fmt: skip


def _footprint(geometry: JsonObject) -> JsonObject:
    if "radius_m" in geometry:
        diameter_m = 2.0 * _number(geometry["radius_m"])
        return {"kind": "round", "length_m": diameter_m, "width_m": diameter_m}
    if "length_m" in geometry and "width_m" in geometry:
        return {
            "kind": "car", "length_m": _number(geometry["length_m"]), "width_m": _number(geometry["width_m"]),
        }  # fmt: skip
    return DEFAULT_FOOTPRINT


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else 0.0


def _blocks(data: JsonObject, kinds: dict[str, str]) -> JsonObject:
    """Return role → kind of the blocks, including the model."""
    kind_by_role = {role: _table(data, role).get("kind", kind) for role, kind in kinds.items()}
    return {role: str(kind) for role, kind in kind_by_role.items()} | {
        "model": str(_table(data, "model").get("kind", ""))
    }


def route_description(run: Run) -> JsonObject | None:
    """Return the path of the reference for the page, or None for a run without a moving reference."""
    target = run.guide_reference
    if target is None:
        return None
    xy = target.eta[np.isfinite(target.eta).all(axis=1), :2]
    if len(xy) < 2 or not np.ptp(xy, axis=0).any():
        return None
    is_closed = bool(np.hypot(*(xy[-1] - xy[0])) < MAX_CLOSED_GAP_M)
    xy = xy[:: max(1, -(-len(xy) // MAX_ROUTE_POINTS))]
    return {"name": "", "closed": is_closed, "x": xy[:, 0].round(4).tolist(), "y": xy[:, 1].round(4).tolist()}


def run_entry(run: Run, modified_s: float) -> JsonObject:
    """Return the entry of a run in the list of runs."""
    modification_time = datetime.fromtimestamp(modified_s, UTC).isoformat(timespec="seconds")
    return {
        "kind": run.metadata.get("kind", ""), "seconds": run.duration_s, "when": modification_time, "laps": None,
        "verdict": run.metadata.get("verdict", ""),
    }  # fmt: skip
