"""Tune gains for many vehicles: the paper's PD tuned on the vehicle of the file, and over draws of the fit.

    python -m benchmarks.robust --jerk 0      (--smallest: a short trial)

The small vehicle has the errors of a fit of a minute: actuator matrix and gains of the motors 2 %, dry friction 5 %,
lag 10 % (1 std), delay ± 10 ms. Both gains are tested on 200 vehicles that the searches did not use: the median, the
95 % quantile and the largest of their distances beside the path. All begin on the route, because this PD does not
correct an error beside it. The nominal search begins from up to 24 points. With the paper's cost it needs 40 % of the
drives of the search over draws.
"""

import argparse
from dataclasses import replace

import numpy as np

from baqueano.guides.shapes import sinuous_circle
from baqueano.tune import tune
from baqueano.tune.objective import draw_vehicles, rms, tuning_objective
from baqueano.vehicle_file import ParameterCov, load, parse

ROUTE = sinuous_circle(0.6, 0.06, 5, 0.2)
ERRORS = {
    "model.actuator_matrix[0,0]": 0.02, "model.actuator_matrix[2,2]": 0.02, "model.drivetrain.gain[0]": 0.02,
    "model.drivetrain.gain[1]": 0.02, "model.friction.coulomb[0]": 0.05, "model.friction.coulomb[2]": 0.05,
    "model.drivetrain.lag_s": 0.1,
}  # fmt: skip
DRAWS, STARTS, JUDGES, OTHER = 16, 3, 200, 5000
DURATION_S = 10.0  # of a drive


def vehicle():
    """Return the file of the small vehicle with the paper's PD and the covariance ERRORS of a fit."""
    text = load("small").text.replace(
        'kind = "pd_feedforward"', 'kind = "pd"\nalpha = 4.0\nbeta = 1.0\ngamma = 0.1'
    )
    file = parse(text, "small.toml")
    std = np.array([part * float(file.value(name)) for name, part in ERRORS.items()])
    return file.with_values({}, parameter_cov=ParameterCov(tuple(ERRORS), np.diag(std**2)))


def judge_gains(file, gains, count, **options):
    """Return cost (count,) and distance from the reference (count,), rms [mm], of `count` other vehicles."""
    drives = tuning_objective(file, ROUTE, draws=1, **options)
    vehicles = draw_vehicles(file, drives.cases[0].system, count, OTHER)[1][1:]
    drives = replace(drives, vehicles=vehicles)
    case = drives.cases[0]
    costs = [case.figures_kernel.run(case.inputs[0], np.concatenate([gains, v]))[1][0] for v in vehicles]
    return drives.vehicle_costs(gains[None])[0], np.array([1e3 * rms(d) for d in costs])


def main():
    """Print a row for each method of tuning."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--smallest", action="store_true")
    parser.add_argument("--jerk", type=float, default=0.1, help="price of jerks; 0: the paper's cost")
    args = parser.parse_args()
    smallest = args.smallest
    options = {"duration_s": 1.0 if smallest else DURATION_S, "offset_m": 0.0, "jerk_m2": args.jerk}
    draws, judges = (2, 3) if smallest else (DRAWS, JUDGES)
    file = vehicle()
    robust = tune(file, ROUTE, draws=draws, starts=STARTS, polish=False, **options)
    drives = sum(len(d.costs) for d in robust.descents) * (draws + 1)
    nominal = tune(file, ROUTE, starts=STARTS, polish=False, **options)
    drive_count = 1 if smallest else min(24, max(1, STARTS * drives // len(nominal.history)))
    nominal = tune(file, ROUTE, starts=drive_count, polish=False, **options)
    print(
        f"vehicles of the search, drives needed; {judges} other vehicles: cost [m²], distance [mm rms]; gains"
    )
    for name, tuning, per_step in (("nominal", nominal, 1), ("over draws", robust, draws + 1)):
        gains = np.array(list(tuning.values.values()))
        cost, costs = judge_gains(file, gains, judges, **options)
        item = ", ".join(f"{x:.3g}" for x in (*np.quantile(cost, [0.5, 0.95]), cost.max()))
        distances = ", ".join(f"{x:.1f}" for x in (*np.quantile(costs, [0.5, 0.95]), costs.max()))
        drives_needed = sum(len(d.costs) for d in tuning.descents) * per_step
        print(
            f"  {name:10} {per_step:3} {drives_needed:6}   {item}   {distances}   {tuning.values}", flush=True
        )


if __name__ == "__main__":
    main()
