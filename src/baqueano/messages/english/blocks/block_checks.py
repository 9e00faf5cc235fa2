"""English sentences of the checks of blocks, for their authors."""

TEMPLATES: dict[str, str] = {
    "when.start": "at the start",
    "when.psi-one": "at ψ = 1",
    "when.curve": "in a curve",
    "when.tick-of-curve": "tick {tick} of a curve",
    "when.rest": "at rest, without a command",
    "when.rolling": "while rolling freely",
    "when.circle": "on a simulated circle",
    "when.silent": "while all sensors are silent",
    "when.after-measurement": "after a measurement of {value}",
    "when.repeated": "at a repeated tick",
    "when.gap": "after a gap of 0.3 s",
    "when.within": "within 3 s",
    "when.followed": "with a vehicle that follows it without error",
    "when.later": "an hour later",
    "when.around-nan": "around a NaN in {signal}",
    "when.large-command": "at a command of 1e9",
    "when.clock": "with a clock that begins at {begin_ns:.2g} ns",
    "check.no-commands": (
        "{place}: {subject} does not have commands: write commands: ClassVar[int] = 3, the "
        "length of its command."
    ),
    "check.no-drivetrain": (
        "{place}: {subject} does not have a drivetrain, and estimators need one for the forces "
        "on the body. Give it Drivetrain(commands=n)."
    ),
    "check.no-attribute": "{place}: {subject} does not have {name}.",
    "check.no-method": "{place}: {subject} does not have {name}().",
    "check.not-frozen": (
        "{place}: {subject} can be changed after it is made. Write @dataclass(frozen=True, "
        "slots=True, eq=False) above it, so that a replay uses the same block."
    ),
    "check.changes-arguments": (
        "{place}: {subject} changes its arguments ({situation}): make new arrays and NamedTuples, x._replace(…), never "
        "x[…] = …"
    ),
    "check.not-deterministic": (
        "{place}: {subject} is not deterministic ({situation}): its output must depend only on its arguments "
        "and the block's parameters."
    ),
    "check.block-changed": "{place}: {subject} changes the block itself ({situation}). Keep memory in the state.",
    "check.returns": "{place}: {subject} returns an output of type {value}: expected {expected}.",
    "check.returns-of": "{place}: if it is the {role:word}, its step takes (state, {expected}).",
    "check.values": (
        "{place}: {subject} returns {count} values ({situation}): expected two values, (state, output)."
    ),
    "check.two-values": (
        "{place}: {subject} returns only {value} ({situation}): expected two values, (state, output)."
    ),
    "check.no-return": (
        "{place}: {subject} returns None ({situation}): expected two values, (state, output). Is `return` missing?"
    ),
    "check.no-function": (
        "{place}: {subject} returns a {value}: write `return` instead of `yield`, and `def` without `async`."
    ),
    "check.no-numbers": "{place}: {subject} gives {field} = {value}: expected real numbers of shape {shape}.",
    "check.shape": "{place}: {subject} gives {field} with shape {value}: expected {shape}.",
    "check.not-finite": "{place}: {subject} gives {field} = {value} ({situation}): expected finite numbers.",
    "check.stamp": "{place}: {subject} stamps its output with {value} instead of {signal}.t_ns = {t_ns} ({situation}).",
    "check.not-wrapped": (
        "{place}: {subject} gives {field} = {psi_rad:.4g} rad ({situation}): expected an angle in [-π, π]: "
        "use geometry.wrap."
    ),
    "check.not-symmetric": "{place}: {subject} gives a {field} that is not symmetric ({situation}).",
    "check.eigenvalue": (
        "{place}: {subject} gives a {field} with the eigenvalue {smallest:.3g} ({situation}): the eigenvalues of "
        "a covariance are 0 or more. The Joseph form ensures this: (I - K H) P (I - K H)ᵀ + K Q Kᵀ."
    ),
    "check.raises": "{place}: {subject} raises {error} ({situation}).",
    "check.raises-on-line": "{place}: {subject} raises {error} on line {line} ({situation}).",
    "check.assigns-field": (
        "{place}: {subject} changes the block on line {line} ({error}). Fields are parameters and stay constant: keep "
        "memory in the state."
    ),
    "check.moves-by-itself": "{place}: {subject} moves {distance} within 2 s without a command, on a level floor.",
    "check.gains-speed": "{place}: {subject} gains speed without a command: ν goes from {first_speed} to {last_speed}.",
    "check.no-noise-field": (
        "{place}: {subject} lacks a field for the noise that a fit measures. Add measurement_noise_cov: "
        "np.ndarray | None = None, and return it from cov if it is not None."
    ),
    "check.no-noise": (
        "{place}: {subject} has a cov with 0 on its diagonal, so an estimator would divide by 0. Give it a "
        "variance above 0."
    ),
    "check.is-new": "{place}: {subject} gives is_new = {value}: expected 1.0 when a measurement arrived, else 0.0.",
    "check.not-new": "{place}: {subject} gives a measurement with is_new = 0: then its z must be zeros.",
    "check.rate": (
        "{place}: {subject} gives {count} measurements in {duration_s:g} s: rate_hz = "
        "{rate_hz:g} requires {expected:.0f}."
    ),
    "check.constant-covariance": (
        "{place}: {subject} gives the same covariance of the position after 2 s without sensors. "
        "Predict at every tick, so that the covariance grows."
    ),
    "check.full-turn": (
        "{place}: {subject} gives another command when a full turn is added to ψ of the "
        "reference: wrap the difference."
    ),
    "check.world-moved": (
        "{place}: {subject} gives another command when the whole map is moved and turned. Use "
        "geometry.pose_error, the error in the frame of the vehicle."
    ),
    "check.at-end": "{place}: {subject} gives at_end = {value}: expected 1.0 at the end of the route, else 0.0.",
    "check.jump": (
        "{place}: {subject} moves its reference by {step_m:.2g} m within one tick, {t_s:.2f} s after the start. "
        "At its largest velocity it moves by {travel_m:.2g} m per tick. Move the pose with the velocity: eta and nu of "
        "one motion."
    ),
    "check.nan-output": "{place}: {subject} outputs {u} after a NaN in {signal}: expected zeros.",
    "check.stop-not-latched": (
        "{place}: {subject} lets the vehicle drive again by itself after a NaN in {signal}: a stop is final."
    ),
    "check.beyond-limit": "{place}: {subject} outputs {u}, which exceeds its limit {limit}.",
    "check.clock": (
        "{place}: {subject} depends on the start of the clock. At tick {tick} its {name} is {value} with a "
        "clock that starts at {begin_ns:.2g} ns (since 1970), and {expected} with one from 0. Count time "
        "from the first tick: keep t_ns in the state, -1 before the first tick."
    ),
    "check.slow": "{place}: {subject} works, but it cannot be compiled, so simulations with it are slow: {cause}",
    "check.must-compile": (
        "{place}: {subject} cannot be compiled, but simulations, estimators and fits need this: {cause}"
    ),
    "check.not-compiled": "{place}: {subject} works, but cannot be compiled: {error}",
    "check.compiled-output": (
        "{place}: {subject} gives other values when it is compiled. It must depend only on its "
        "arguments and fields."
    ),
    "outside.imports": "{place} imports {name}: {advice}.",
    "outside.draws": "{place} uses numpy's random numbers: {advice}.",
    "outside.calls": "{place} calls {name}(): {advice}.",
    "outside.global": "{place} writes the global {name}: {advice}.",
    "outside.comma": "{place}: {name} is two numbers with a comma between them: {advice}.",
    "outside.decimal": "write a decimal point, as in {value}",
    "outside.time": "time arrives with the signal: seconds(tick.t_ns, belief.t_ns)",
    "outside.random": "random numbers are inputs, drawn from the seed of the run",
    "outside.machine": "a block cannot use files or the system; its parameters come from the vehicle file",
    "outside.files": "a block cannot read files; its parameters come from the vehicle file",
    "outside.talks": "a block receives inputs only from the loop: they arrive with the tick",
    "outside.threads": "a block runs only when the loop calls step(), once per tick",
    "outside.starts": "a block cannot start other programs",
    "outside.prints": "a block cannot print; put the value into its output",
    "outside.input": "a block cannot ask the user",
    "outside.state": "keep memory in the state",
}
