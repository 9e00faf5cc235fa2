"""English sentences about the fields of blocks: vehicles, sensors, estimators, guides, controllers."""

TEMPLATES: dict[str, str] = {
    "field.limit": (
        "{block}.limit has shape {value}: expected ({commands},), one number per command of the vehicle."
    ),
    "pd.limit": (
        "Pd.limit has shape {value}: expected (3,) for (u_x, u_y, u_psi), or (2,) for (throttle, servo): one "
        "number per command of the vehicle."
    ),
    "cov.shape": "{name} has shape {value}, expected ({size}, {size}).",
    "cov.not-finite": "{name}[{i}][{j}] = {value}: expected a finite number.",
    "cov.not-symmetric": "{name} is not symmetric: [{i}][{j}] = {first:g} but [{j}][{i}] = {second:g}. {offer}",
    "cov.eigenvalue": (
        "{name} has the eigenvalue {smallest:.3g}; the eigenvalues of a covariance are 0 or more. "
        "[{i}][{j}] = {entry:g} is too large for the diagonal entries {first:g} and {second:g}. {offer}"
    ),
    "ekf.mode": 'mode = "{value}": expected one of {valid}.',
    "ekf.positive": (
        "rate_hz = {rate_hz}, gate_sigma = {gate_sigma}, disturbance_time_s = {disturbance_time_s}: each "
        "must be greater than 0. To accept every measurement, set gate_sigma = inf."
    ),
    "ekf.initial-std": "initial_std = {value}: expected 9 numbers greater than 0, for (η, ν, ν̇).",
    "field.use": 'use = "{value}": the vehicle does not have this sensor; it has {valid}.',
    "follower.no-law": (
        "{block} does not have a control law: write its method velocity_law(self, memory, now). It returns the memory "
        "and the velocity (v, ω). An example: docs/controllers.md"
    ),
    "follower.law-result": (
        "{block}.velocity_law() must return two values: the memory, and the velocity (v, ω), as in "
        "return memory, (v, omega). An example: docs/controllers.md"
    ),
    "vehicle.no-equation": (
        "{vehicle} does not have an equation of motion: write its method nu_dot(self, nu, effort, psi). It returns "
        "ν̇ (3,). An example: docs/own-vehicle.md"
    ),
    "unscented.no-acceleration": (
        "{vehicle} does not have nu_dot, its acceleration, which this filter estimates: use ekf."
    ),
    "route.shapes": (
        "The route has t_s {t_s}, eta {eta}, nu {nu}: expected (m,), (m, 3), (m, 3) with the same m "
        "of at least 2."
    ),
    "route.not-finite": "The route has a number that is not finite: teach it again, or cut that part out.",
    "guide.times": "The route's times must start at 0 and increase; they start {value} s.",
    "route.laps": "laps = {value}: expected 0 (for ever) or more.",
    "route.laps-kept": (
        "{kind}.laps = {former_laps} cannot become {laps}: {cause}. Write self.laps = laps in __init__, or do "
        "not give laps."
    ),
    "shape.length": "length {value:g} m: expected a positive number.",
    "shape.unknown": "Shape {value} does not exist. {suggestion}.",
    "shape.corners": (
        "A rectangle of {length_m} m by {width_m} m is too small for corners of radius {corner_m} m. The "
        "radius must be above 0 and below {max_m:g} m."
    ),
    "shape.amplitude": (
        "SinuousCircle.amplitude_m = {amplitude_m} m: expected less than radius_m = {radius_m} m."
    ),
    "imu.model": "Imu.measurement_model = {value}: expected one of {valid}.",
    "tags.points": (
        "Tags.points_m has shape {value}: expected (n, 2), a row (x, y) for each tag, such as [[0.0, 0.0], [1.2, "
        "0.8]]."
    ),
    "field.one-number": "{field} = {value}: expected one number [{unit_name}], {meaning:word}.",
    "field.not-array": "{field} = {value}: expected a NumPy array, {meaning:word}; write np.array([...]).",
    "field.shape": "{field} has shape {value}: expected {expected} [{unit_name}], {meaning:word}.",
    "field.not-finite": "{field} = {value}: expected finite numbers [{unit_name}], {meaning:word}.",
    "field.range": "{field} = {value}: expected values from {low:g} to {high:g} [{unit_name}], {meaning:word}.",
    "delay.slots": "{name}.delay_slots = {value}: expected a whole number, 0 or more.",
    "delay.no-slots": (
        "{name}.delay_s = {delay_s:g} s but delay_slots = 0, so past values are not stored. Give "
        "delay_slots = delay_s · rate_hz rounded up, {slots} at 100 Hz."
    ),
    "drivetrain.lag-tiny": (
        "Drivetrain.{name} = {lag_s:.3g} s is too small for the computation. Give 0 without a lag, "
        "or the time constant, usually 0.01 to 0.2 s."
    ),
    "drivetrain.mixing": "Drivetrain.mixing = {value}: expected one of {valid}.",
    "drivetrain.battery": "Drivetrain.battery = {value}: expected one of {valid}.",
    "drivetrain.commands": (
        "Drivetrain.commands = {commands}: two_wheels mixes three commands, (u_x, u_y, u_psi)."
    ),
    "drivetrain.lag": "Drivetrain.{name} = 0 with {flag} = True: expected a time constant above 0 s.",
    "drivetrain.shape": (
        "Drivetrain.{name} has shape {value}: expected ({channels},), one value per channel of mixing = {mixing} "
        "with {commands} commands, or (1,) for all."
    ),
    "friction.track": (
        "Friction.track_m = 0 with dry friction of a wheel. Expected the distance from the left to the "
        "right wheel [m], the lever arm that turns the vehicle."
    ),
    "vehicle.commands": (
        "{model} has {commands} commands ({names}), but its drivetrain has {rows}: give "
        "Drivetrain(commands={commands})."
    ),
    "replay.empty": "{run} is empty: it contains 0 ticks.",
    "robot.mixing": (
        '[model.drivetrain] mixing = "{mixing}": the firmware drives a left and a right wheel. Write: mixing = '
        '"two_wheels"'
    ),
    "room.too-small": (
        "The vehicle cannot stay in a room of {width_m:g} × {height_m:g} m. Even without a command, its "
        "corridor extends {excess_m:.2f} m beyond the wall. Give a larger room, or start further from the "
        "wall."
    ),
    "field.role": "role = {value}: expected one of {valid}.",
}
