"""English sentences about simulations."""

TEMPLATES: dict[str, str] = {
    "simulate.as-written": (
        "The {role} {block} depends on a solver, a person or a clock, so its step cannot be compiled. It "
        "cannot be tuned or simulated in one kernel. Run it tick by tick: {fix}"
    ),
    "simulate.never-done": (
        "This guide does not end within {limit_h:g} hours. Give fewer laps, but at least 1. In Python, duration_s also "
        "ends a simulation."
    ),
    "simulate.vary-shape": 'vary["{path}"] has shape {value}: expected {expected}, a row per vehicle.',
    "simulate.vary-count": 'vary["{path}"] is for {value} vehicles, but another value is for {expected}.',
    "simulate.vary-not-finite": 'vary["{path}"] contains a number that is not finite.',
    "simulate.no-vehicles": (
        "The number of vehicles is 0: give vary = {{path: values}} with a row per vehicle, or vehicles."
    ),
    "simulate.no-covariance": (
        "{name}: no parameter has a covariance yet, so vehicles cannot be drawn. Fit the model: "
        "{fix}, or state what varies: vary = {{path: values}}."
    ),
    "simulate.vehicles": "vehicles = {vehicles}: expected 1 or more.",
    "simulate.signal-shape": (
        "The command signal has shape {value}: expected (N, {commands}), one row per tick with {names}."
    ),
    "simulate.not-finite": "{name} = {value} at tick {tick}: expected a finite number.",
    "simulate.beyond-limit": (
        "{name} = {value:g} at tick {tick}: the vehicle file allows up to {limit:g} ([command] limit). Scale the "
        "signal, or write np.clip(u, -limit, limit)."
    ),
    "simulate.pose": "{name} = {value}: expected three finite numbers.",
    "simulate.no-number": (
        '"{path}" is not a number of this vehicle: {cause}. Name it as in the vehicle file, for '
        'example "model.friction.linear".'
    ),
}
