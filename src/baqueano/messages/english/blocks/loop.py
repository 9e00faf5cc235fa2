"""English sentences of the loop, its blocks, its supervisor and its driver."""

from baqueano.diagnostics import StopReason as S

TEMPLATES: dict[str, str] = {
    S.COMMAND_NOT_FINITE: "the command is not a finite number",
    S.ESTIMATE_NOT_FINITE: "the estimate is not a finite number",
    S.SPEED: "the vehicle is faster than max_speed_m_s",
    S.YAW_RATE: "the vehicle turns faster than max_yaw_rate_rad_s",
    S.POSITION_UNCERTAIN: "the position is less certain than max_position_std_m",
    S.SENSOR_SILENT: "the IMU has been silent for imu_timeout_s",
    S.OWN_REASON: "{words}",
    S.BLOCK_RAISED: "{block} raised {error}",
    S.BLOCK_RAISED_IN_INIT: "{block} raised {error} in init()",
    S.BLOCK_RETURNED: "{block} returned {found}, expected {expected}",
    S.INTERRUPTED: "interrupted from the keyboard",
    S.DRIVER: "stopped by the driver",
    S.PAD_UNPLUGGED: "the game pad was unplugged",
    S.TERMINAL_CLOSED: "the terminal was closed",
    S.TERMINAL_SILENT: "the terminal has not answered for {silent_ms:.0f} ms",
    S.PROGRAM_ENDED: "another process ended the program",
    S.RECORDED: "{words}",
    "drive.on-mark": "on the mark",
    "drive.disk-full": "the disk is full and does not store more of this run ({error}); the drive goes on",
    "drive.not-compiled": "{room} {block} runs as it is written, not compiled: {error}",
    "drive.not-watched": "the sensors are not watched: {error}",
    "drive.other-vehicle": (
        "{file} has {found} commands and the world's vehicle takes {expected}: they are not the same kind of vehicle."
    ),
    "drive.own-origin": (
        "estimator {block} starts at its own origin, the vehicle at {start}: write init(self, eta=None)"
    ),
}
