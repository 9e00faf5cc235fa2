"""Write a fit into the vehicle file: values, their origin, their errors, and their covariance.

The bias b ± s of a run is not written if the bias b₀ ± s₀ of the file is more accurate and not contradicted:

    s > s₀   and   |b − b₀| ≤ K √(s² + s₀²),   K = CONTRADICTION_SIGMA                                    (1)

A drive determines the bias of a gyro only to some hundredths of a rad/s. A rest in the runs gives b₀ ± s₀
(calibration/rest.py). If the run contradicts the file, b is written, with s as s₀. An unmeasured gyro has the s₀ that
the file states, or that of a data sheet; s is written. The envelope is the range of each command and of each
channel whose h depends on ν. It excludes readings beyond OUTLIER_SIGMA standard deviations from the model.
"""

from collections.abc import Sequence
from datetime import date
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.calibration.rest import speed_channels
from baqueano.calibration.tolerances import assumed_gyro_bias_std, measured_gyro_bias_std
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, note
from baqueano.identify.data.added_channels import MOUNT_PREFIX
from baqueano.identify.data.record import FitRecord
from baqueano.parameter import parameters
from baqueano.signals import ByName
from baqueano.symbolic import value_at_path, with_value
from baqueano.vehicle_file.envelope import Envelope

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject
    from baqueano.identify.result.fit_result import ChannelFit, Fit
    from baqueano.vehicle_file import VehicleFile

CONTRADICTION_SIGMA = 4.0  # standard deviations, as in the gates of the filters
OUTLIER_SIGMA = 4.0


class Prior(NamedTuple):
    """A bias that the file contains more accurately than the fit."""

    path: str
    unit: str
    value: float
    prior_std: float  # s₀
    std_path: str  # the field of s₀
    std: float  # s
    contradicted: bool
    at_rest: bool  # True if the value was measured at rest in the runs of the fit

    @property
    def message(self) -> Diagnostic:
        """Return a message on the value that is written, and the reason."""
        code = "bias.contradicts-file" if self.contradicted else "bias.file-better"
        figures: JsonObject = {"value": self.value, "prior_std": self.prior_std}
        return note(code, subject=self.path, **figures, unit=self.unit, std=self.std)


def fit_file(fit: "Fit", on: date | None = None) -> "VehicleFile":
    """Return the file with the estimates of `fit`; entries that were not identifiable are unchanged."""
    from baqueano.vehicle_file import ParameterCov

    on, run = on or date.today(), ", ".join(fit.runs)
    values: JsonObject = {}
    provenance: JsonObject = {}
    blocks, priors = fit.blocks, kept_priors(fit)
    for prior in priors:
        if not prior.contradicted:
            blocks = with_value(blocks, prior.path, prior.value)
    for field, std in _fields(fit, [prior.path for prior in priors if not prior.contradicted]).items():
        number = value_at_path(blocks, field)
        values[field] = np.asarray(number, float).tolist() if np.ndim(number) else float(number)
        provenance[field] = {"run": run, "date": on, "std": std, "verdict": fit.verdict}
    for field in dict.fromkeys(prior.std_path.partition("[")[0] for prior in priors if prior.contradicted):
        entries_ = np.array(value_at_path(fit.file, field), dtype=float)
        for prior in (prior for prior in priors if prior.contradicted and prior.std_path.startswith(field)):
            entries_[_index(prior.std_path)] = max(entries_[_index(prior.std_path)], prior.std)
        values[field] = entries_.tolist()
    stds = dict(zip(fit.fixed.paths, np.sqrt(np.diagonal(fit.fixed.cov)).tolist(), strict=True))
    stds |= {path: origin["std"] for path, origin in provenance.items()}
    for name in (x for x in fit.file.sensors._fields if measured_gyro_bias_std(fit.file, x) is None):
        path = f"sensors.{name}.gyro_bias"
        values |= {f"{path}_std": stds[path]} if path in stds else {}
    if getattr(getattr(fit.blocks.model, "drivetrain", None), "battery", "steady") == "logged":
        values["model.drivetrain.battery"] = "logged"
    entries_ = [
        k for k, name in enumerate(fit.names) if np.isfinite(fit.std[k]) and not name.startswith(MOUNT_PREFIX)
    ]
    cov = ParameterCov(tuple(fit.names[k] for k in entries_), fit.cov[np.ix_(entries_, entries_)], run, on)
    return fit.file.with_values(values, provenance, cov, fit.envelope)


def kept_priors(fit: "Fit") -> tuple[Prior, ...]:
    """Return the biases that the file contains more accurately than the fit, even if the fit contradicts them.  (1)"""
    priors, rest_messages = [], [message for message in fit.notes if message.code == "bias.at-rest"]
    stds = np.sqrt(np.mean(fit.run_entry_std**2, axis=0))
    for path, x, std in zip(fit.run_entry_names, np.mean(fit.run_entries, axis=0), stds, strict=True):
        sensor, _, field = path.removeprefix("sensors.").partition(".")
        if not path.startswith("sensors.") or sensor not in fit.file.sensors._fields:
            continue
        name = field.partition("[")[0]
        description = dict(parameters(getattr(fit.file.sensors, sensor))).get(name)
        if description is None or not description.std or not np.isfinite(std):
            continue
        std_path = f"sensors.{sensor}.{description.std}{field.removeprefix(name)}"
        prior, prior_std = float(value_at_path(fit.file, path)), float(value_at_path(fit.file, std_path))
        at_rest = path in (f"sensors.{message.subject}.gyro_bias" for message in rest_messages)
        if name == "gyro_bias" and (at_rest or measured_gyro_bias_std(fit.file, sensor) is None):
            prior_std = assumed_gyro_bias_std(fit.file, sensor)
        if std > prior_std:
            unit = description.unit.split(", ")[0]
            contradicted = bool(abs(x - prior) > CONTRADICTION_SIGMA * np.hypot(std, prior_std))
            priors.append(Prior(path, unit, prior, prior_std, std_path, float(std), contradicted, at_rest))
    return tuple(priors)


def _index(path: str) -> tuple[int, ...]:
    """Return the entry that a path names, () for a whole field."""
    return tuple(int(i) for i in path.partition("[")[2].rstrip("]").split(",") if i)


def _fields(fit: "Fit", prior_paths: Sequence[str]) -> "JsonObject":
    """Return field → standard errors in its shape, NaN for entries without an estimate and for `prior_paths`."""
    std_by_name = dict(zip(fit.names, fit.std, strict=True))
    fitted_names = [n for n, x in zip(fit.names, fit.estimate, strict=True) if np.isfinite(x)]
    for name, std in zip(fit.run_entry_names, np.sqrt(np.mean(fit.run_entry_std**2, axis=0)), strict=True):
        if name.startswith("sensors.") and np.isfinite(std) and name not in prior_paths:
            std_by_name[name] = std
            fitted_names.append(name)
    field_std: dict[str, Tree] = {}
    for path in (path for path in fitted_names if not path.startswith(MOUNT_PREFIX)):
        field, bracket, _ = path.partition("[")
        if not bracket:
            field_std[field] = float(std_by_name[path])
            continue
        if field not in field_std:
            field_std[field] = np.full(np.shape(value_at_path(fit.blocks, field)), np.nan)
        field_std[field][_index(path)] = std_by_name[path]
    return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in field_std.items()}


def fit_envelope(
    records: Sequence[FitRecord],
    channels: "Sequence[ChannelFit]",
    sensors: ByName[Tree],
    commands: Sequence[str],
) -> Envelope:
    """Return the envelope of a fit to `records`, whose `commands` are in the order of u."""
    u = np.concatenate([record.u[record.lead :] for record in records])
    ranges = {name: (float(u[:, k].min()), float(u[:, k].max())) for k, name in enumerate(commands)}
    for name, sensor in sensors._asdict().items():
        for entry in np.flatnonzero(speed_channels(sensor)):
            channel_fits = [
                c
                for c in channels
                if (c.sensor, c.entry) == (name, entry) and np.isfinite(c.explained_fraction)
            ]
            z = [c.measurements[np.abs(c.residuals) <= OUTLIER_SIGMA * c.sigma] for c in channel_fits]
            if sum(map(len, z)):
                ranges[f"{name}[{entry}]"] = (
                    min(x.min() for x in z if len(x)),
                    max(x.max() for x in z if len(x)),
                )
    low, high = np.array(list(ranges.values())).T
    runs = dict.fromkeys(record.name for record in records)
    return Envelope(tuple(ranges), low, high, ", ".join(runs))
