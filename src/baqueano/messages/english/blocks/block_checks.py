"""English sentences of the trials of blocks, for their authors."""

TEMPLATES: dict[str, str] = {
    "when.start": "at the start",
    "when.psi-one": "at ψ = 1",
    "when.curve": "in a curve",
    "when.tick-of-curve": "tick {tick} of a curve",
    "when.rest": "at rest, without a command",
    "when.rolling": "rolling free",
    "when.circle": "in a circle",
    "when.silent": "while all sensors are silent",
    "when.after-measurement": "after a measurement of {found}",
    "when.repeated": "at a repeated tick",
    "when.gap": "after a gap of 0.3 s",
    "when.within": "within 3 s",
    "when.hour-later": "an hour later",
    "when.around-nan": "around a NaN in {what}",
    "when.large-command": "at a command of 1e9",
    "when.clock": "with a clock that begins at {begin_ns:.2g} ns",
    "check.no-commands": (
        "{place}: {subject} lacks commands: write commands: ClassVar[int] = 3, the length of its command."
    ),
    "check.no-drivetrain": (
        "{place}: {subject} lacks a drivetrain: estimators ask it what the body feels. Give it "
        "Drivetrain(commands=n)."
    ),
    "check.no-attribute": "{place}: {subject} lacks {name}.",
    "check.no-method": "{place}: {subject} lacks {name}().",
    "check.not-frozen": (
        "{place}: {subject} can be changed after it is built. Write @dataclass(frozen=True, slots=True, eq=False) "
        "above it, so that a replay meets the same block."
    ),
    "check.changes-arguments": (
        "{place}: {subject} changes its arguments ({when}): make new arrays and NamedTuples, x._replace(…), never "
        "x[…] = …"
    ),
    "check.two-answers": (
        "{place}: {subject} gives two answers to the same question ({when}): it may depend on its arguments and the "
        "block's parameters alone."
    ),
    "check.changes-itself": (
        "{place}: {subject} changes the block itself ({when}): what is remembered goes into the state."
    ),
    "check.returns": "{place}: {subject} returns {found}: expected {expected}.",
    "check.values": "{place}: {subject} returns {count} values ({when}): expected two, (state, output).",
    "check.one-value": "{place}: {subject} returns {found} alone ({when}): expected two, (state, output).",
    "check.no-numbers": "{place}: {subject} gives {what} = {found}: expected numbers of shape {shape}.",
    "check.shape": "{place}: {subject} gives {what} with shape {found}: expected {shape}.",
    "check.not-finite": "{place}: {subject} gives {what} = {found} ({when}): expected finite numbers.",
    "check.stamp": "{place}: {subject} stamps its output with {found} instead of {of}.t_ns = {t_ns} ({when}).",
    "check.not-wrapped": (
        "{place}: {subject} gives {what} = {psi_rad:.4g} rad ({when}): expected it wrapped to [-π, π], geometry.wrap."
    ),
    "check.not-symmetric": "{place}: {subject} gives a {what} that is not symmetric ({when}).",
    "check.eigenvalue": (
        "{place}: {subject} gives a {what} with the eigenvalue {smallest:.3g} ({when}): those of a "
        "covariance are 0 or more. The form of Joseph keeps it so: (I - K H) P (I - K H)ᵀ + K Q Kᵀ."
    ),
    "check.raises": "{place}: {subject} raises {error} ({when}).",
    "check.raises-on-line": "{place}: {subject} raises {error} on line {line} ({when}).",
    "check.moves-by-itself": (
        "{place}: {subject} moves {moved} within 2 s without a command, on a level floor."
    ),
    "check.gains-speed": (
        "{place}: {subject} gains speed without a command: ν goes from {before} to {after}."
    ),
    "check.no-noise": (
        "{place}: {subject} has a cov with 0 on its diagonal: an estimator would divide by it. Give it some noise."
    ),
    "check.has": "{place}: {subject} says has = {found}: expected 1.0 where a measurement arrived, else 0.0.",
    "check.has-not": "{place}: {subject} gives a measurement with has = 0: its z must be zeros then.",
    "check.rate": (
        "{place}: {subject} answers {answers} times in {lasted_s:g} s: rate_hz = {rate_hz:g} promises {wanted:.0f}."
    ),
    "check.sure-without-sensors": (
        "{place}: {subject} is as sure of its position after 2 s without any sensor as before: predict at every tick, "
        "and let the covariance grow."
    ),
    "check.full-turn": (
        "{place}: {subject} gives another command when ψ of the reference is a full turn further: wrap the difference."
    ),
    "check.world-moved": (
        "{place}: {subject} gives another command when the whole world is moved and turned: work with "
        "geometry.pose_error, the reference seen from the vehicle."
    ),
    "check.done": "{place}: {subject} says done = {found}: expected 1.0 when nothing more is asked for, else 0.0.",
    "check.lets-through": "{place}: {subject} lets {u} through after a NaN in {what}: expected zeros.",
    "check.drives-again": (
        "{place}: {subject} lets the vehicle drive again by itself after a NaN in {what}: a stop is for good."
    ),
    "check.beyond-limit": "{place}: {subject} lets {u} through, beyond its limit {limit}.",
    "check.clock": (
        "{place}: {subject} gives another {name} when the clock begins at {begin_ns:.2g} ns, a time since 1970, than "
        "when it begins at 0 (tick {tick}: {found}, not {expected}): count time from the first tick. Keep t_ns in the "
        "state, -1 before there was a tick."
    ),
    "check.slow": "{place}: {subject} works, but cannot be compiled, so simulations with it are slow: {cause}",
    "check.not-compiled": "{place}: {subject} works, but cannot be compiled: {error}",
    "check.compiled-otherwise": (
        "{place}: {subject} gives other numbers when it is compiled: does it depend on anything but its arguments and "
        "fields?"
    ),
    "outside.imports": "{place} imports {name}: {instead}.",
    "outside.draws": "{place} uses numpy's random numbers: {instead}.",
    "outside.calls": "{place} calls {name}(): {instead}.",
    "outside.global": "{place} writes the global {name}: {instead}.",
    "outside.time": "time comes with the signal: seconds(tick.t_ns, belief.t_ns)",
    "outside.random": "noise comes from outside, drawn from the seed of the run",
    "outside.machine": "a block knows no files and no machine; parameters come from the vehicle file",
    "outside.files": "a block knows no files; parameters come from the vehicle file",
    "outside.talks": "a block exchanges data with the loop alone: its inputs come with the tick",
    "outside.threads": "a block runs only when the loop calls step(), once a tick",
    "outside.starts": "a block starts nothing",
    "outside.prints": "a block prints nothing; what it says goes into its output",
    "outside.asks": "a block asks nobody",
    "outside.state": "what is remembered goes into the state",
}
