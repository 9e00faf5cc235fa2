"""A fit → the vehicle file: values, where they come from, how sure they are, and their covariance."""

from datetime import date
from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.identify.rows.truth import MOUNT
from baqueano.symbolic import get

if TYPE_CHECKING:
    from baqueano.identify.answer.result import Fit
    from baqueano.vehicle_file import VehicleFile


def written(fit: "Fit", on: date | None = None) -> "VehicleFile":
    """The file with the estimates of `fit`, entries that were not seen as they were."""
    from baqueano.vehicle_file import ParameterCov

    on, run = on or date.today(), ", ".join(fit.runs)
    values: dict[str, Any] = {}
    provenance: dict[str, Any] = {}
    for field, sd in _fields(fit).items():
        number = get(fit.blocks, field)
        values[field] = np.asarray(number, float).tolist() if np.ndim(number) else float(number)
        provenance[field] = {"run": run, "date": on, "sd": sd, "verdict": fit.verdict}
    if getattr(getattr(fit.blocks.model, "drivetrain", None), "battery", "steady") == "logged":
        values["model.drivetrain.battery"] = "logged"
    known = [k for k, name in enumerate(fit.names) if np.isfinite(fit.sd[k]) and not name.startswith(MOUNT)]
    cov = ParameterCov(tuple(fit.names[k] for k in known), fit.cov[np.ix_(known, known)], run, on)
    return fit.file.with_values(values, provenance, cov, fit.envelope)


def _fields(fit: "Fit") -> dict[str, Any]:
    """Path of a field → standard errors in its shape, NaN for entries that were not told."""
    said = dict(zip(fit.names, fit.sd, strict=True))
    told = {n for n, x in zip(fit.names, fit.estimate, strict=True) if np.isfinite(x)}
    for name, sd in zip(fit.own_names, np.sqrt(np.mean(fit.own_sd**2, axis=0)), strict=True):
        if name.startswith("sensors.") and np.isfinite(sd):
            said[name] = sd
            told.add(name)
    out: dict[str, Any] = {}
    for path in (path for path in told if not path.startswith(MOUNT)):
        field, bracket, entry = path.partition("[")
        if not bracket:
            out[field] = float(said[path])
            continue
        if field not in out:
            out[field] = np.full(np.shape(get(fit.blocks, field)), np.nan)
        out[field][tuple(int(i) for i in entry.rstrip("]").split(","))] = said[path]
    return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in out.items()}
