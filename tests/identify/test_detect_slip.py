"""Slipping tyres: their drag is estimated in addition to the modelled cornering drag."""

import numpy as np

from baqueano.identify import identify
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import FREE_CAR, car_file, car_values, drive_group, run_of_vehicle
from baqueano.study.identification import trials

SECONDS = 30.0
DRAG = "model.linear_drag"


def test_unmodelled_tyre_slip_drag_widens_the_errors():
    """A car of the independent truth has soft tyres. The estimate of its rolling drag is too low, because slip
    explains a part of it."""
    car = trials.draw_car(702, "understeer")
    file = car_file(car)
    u = trials._car_steps(702, file.rate_hz, SECONDS, trials.STEERING_AMPLITUDE["understeer"])
    motion = drive_group(car, u[:, None], [702], tick_times(len(u), file.rate_hz))
    fit = identify(run_of_vehicle(motion, 0, u, file, "soft tyres", 702), file, FREE_CAR)
    k = fit.names.index(DRAG)
    off = fit.estimate[k] - float(car_values(car)[DRAG][0])
    assert fit.verdict == "WARN"
    assert "slip, x" in [reason.figures.get("term") for reason in fit.reasons]
    assert abs(off) < 1.96 * fit.sd[k]
    assert np.isfinite(fit.sd[k])
