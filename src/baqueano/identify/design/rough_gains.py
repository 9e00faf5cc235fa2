"""Choose the vehicle file with which the experiment after a first drive is planned.

The fit to a first drive can lack the parameters that slow the vehicle down. A plan with such a fit expects vehicles
that never stop. It then uses the rough gains of the first drive, with their standard error

    σ = ROUGH_GAIN_STD · gain                                                                             (1)

ROUGH_GAIN_STD was measured on the robots of study/first_drives.py. Over 38 of them the rms of ln (rough gain / true
gain) is 0.20 along x and 0.29 about z. The larger value, rounded, applies to each gain.
"""

from typing import TYPE_CHECKING

import numpy as np

from baqueano.diagnostics import Verdict
from baqueano.parameter import all_parameters
from baqueano.vehicle_file import ParameterCov
from baqueano.vehicles.freedoms import damping_derivatives

if TYPE_CHECKING:
    from baqueano.identify.result.fit_result import Fit
    from baqueano.vehicle_file.file import VehicleFile

ROUGH_GAIN_STD = 0.3


def planning_file(fit: "Fit", rough_file: "VehicleFile") -> "VehicleFile":
    """Return the file for the plan after a first drive.

    Parameters
    ----------
    fit : Fit
        The fit to the first drive.
    rough_file : VehicleFile
        The file with the rough gains of that drive, from `with_rough_gains`.

    Returns
    -------
    VehicleFile
        The file of the fit. If the fit is refused, the rough file; if it does not show how the vehicle stops, the rough
        file with the standard errors of its gains.
    """
    if undetermined_damping(fit):
        return with_uncertain_gains(rough_file)
    return rough_file if fit.verdict == Verdict.REFUSED else fit.vehicle_file


def with_uncertain_gains(rough_file: "VehicleFile") -> "VehicleFile":
    """Return the file with the standard errors of its rough gains.  (1)

    A plan then takes the other guesses as more uncertain, see `possible_vehicles`: the first drive measured the
    response at low speed only.
    """
    scalar_gains = {
        path: float(rough_file.value(path))
        for path, p in all_parameters(rough_file.vehicle, "model")
        if p.role == "gain" and np.ndim(rough_file.value(path)) == 0
    }
    variances = (ROUGH_GAIN_STD * np.array(list(scalar_gains.values()))) ** 2
    return rough_file.with_values({}, parameter_cov=ParameterCov(tuple(scalar_gains), np.diag(variances)))


def undetermined_damping(fit: "Fit") -> list[str]:
    """Return the parameters that slow a forward motion, if the fit does not determine them or found only a bound 0."""
    fields = {name.partition("[")[0] for name in fit.names}
    damping = {path for path, slope in damping_derivatives(fit.blocks.model, fields) if slope[0] > 0.0}
    is_unknown = ~np.isfinite(fit.estimate) | (fit.poorly_identified & (fit.bound < 0))
    return [name for name, unknown in zip(fit.names, is_unknown, strict=True) if unknown and name in damping]
