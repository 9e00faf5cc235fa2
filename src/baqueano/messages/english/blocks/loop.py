"""English sentences about the loop, its blocks, its supervisor and its driver."""

from baqueano.diagnostics import StopReason as S

TEMPLATES: dict[str, str] = {
    S.COMMAND_NOT_FINITE: "the command is not a finite number",
    S.ESTIMATE_NOT_FINITE: "the estimate is not a finite number",
    S.SPEED: "the vehicle is faster than its limit, max_speed_m_s",
    S.YAW_RATE: "the vehicle turns faster than its limit, max_yaw_rate_rad_s",
    S.POSITION_UNCERTAIN: "the standard deviation of the position exceeds its limit, max_position_std_m",
    S.SENSOR_SILENT: "the IMU has been silent for longer than its limit, imu_timeout_s",
    S.OWN_REASON: "{words}",
    S.BLOCK_RAISED: "{block:block} raised {error}",
    S.BLOCK_RAISED_IN_INIT: "{block:block} raised {error} in init()",
    "block.finite": "finite numbers",
    S.BLOCK_RETURNED: "{block:block} returned {value}, expected {expected}",
    S.INTERRUPTED: "ended by the user",
    S.DRIVER: "stopped by the driver",
    S.PAD_UNPLUGGED: "the game pad was unplugged",
    S.TERMINAL_CLOSED: "the terminal was closed",
    S.TERMINAL_SILENT: "the terminal has not answered for {silent_ms:.0f} ms",
    S.PROGRAM_ENDED: "another process ended the program",
    S.RECORDED: "{words}",
    S.STUCK: "the vehicle has not moved for {rest_s:.0f} s, and its reference is {distance_m:.2f} m away",
    S.TIME_LIMIT: (
        "the guide did not end the drive within {limit_s:.0f} s. A guide ends it with at_end = 1.0. For a longer "
        "drive, use --time-limit SECONDS, in Python time_limit_s=SECONDS"
    ),
    S.ROOM: (
        "the vehicle might leave the room. The wall in direction {axis} is {wall_m:.2f} m from its body. Its position "
        "is uncertain by {region_m:.2f} m (95 %), and it needs {stop_m:.2f} m to stop. Use a smaller route or a larger "
        "room"
    ),
    S.ESTIMATE_DOUBTFUL: "the estimate is not reliable, so the vehicle slowed down and stopped. {cause}",
    "caution.slow": "the vehicle slows down. {cause}",
    "caution.over": "the vehicle continues at its normal speed, because this has ended: {cause}",
    "caution.uncertain": (
        "the standard deviation of the position is {std_m:.2f} m; at {max_m:.2f} m the supervisor stops "
        "the vehicle"
    ),
    "drive.rest": "the vehicle stands still for {rest_s:g} s, to measure the bias of its gyro",
    "drive.end-beside": (
        "the drive ended {distance_cm:.0f} cm from the end of its route, and the heading differs by {turn_deg:.0f}°. "
        "Usually these values are below {max_cm:.0f} cm and {max_deg:.0f}°. Was the vehicle pushed near the end, or "
        "did the wheels slip?"
    ),
    "drive.open-laps": (
        "The route is open, so it is driven once. Laps need a route that ends at its start, with closed = true."
    ),
    "drive.clipped": (
        "{share:.0f} % of the commands {subject} are above the limit of [command], {limit:g}, and are clipped to it. "
        "The largest is {largest:g}. Do they have the unit of the vehicle file, {unit}?"
    ),
    "drive.on-mark": "on the mark",
    "drive.disk-full": (
        "the disk is full, so the rest of this run is not stored ({error}); the drive continues"
    ),
    "drive.not-compiled": "{role} {block} runs without compilation: {error}",
    "drive.not-watched": "The monitor cannot check the sensors: {error}",
    "drive.other-vehicle": (
        "{file} has {value} commands but the vehicle of the world accepts {expected}: they are not the "
        "same kind of vehicle."
    ),
    "world.is-class": "world = class {world}: expected an object of this class. Type: {fix}",
    "world.incomplete": "world={world} is not a simulator: it does not have {names}. Type: {fix}",
    "world.ticks": "{world}.read returned {value}: expected a list of baqueano.signals.Tick.",
    "world.times": (
        "{world}.read returned ticks with the times {value} ns: expected increasing times, the last {expected}."
    ),
    "world.command": (
        "{world}.read returned a tick with u of the shape {value}: expected {expected}, as in the vehicle file."
    ),
    "world.sensors": (
        "{world}.read returned a tick with the sensors {value}: expected those of the vehicle file, {expected}."
    ),
    "world.reading": (
        "{world}.read returned a reading of {subject} with the shape {value}: expected {expected}. A sensor without a "
        "new reading has Slot(0.0, np.zeros(size))."
    ),
    "drive.own-origin": (
        "estimator {block} starts at its own origin, but the vehicle starts at {start}. Write init(self, "
        "eta=None)"
    ),
}
