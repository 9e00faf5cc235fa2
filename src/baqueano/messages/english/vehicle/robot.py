"""English sentences about the real vehicle: the Uno, the IMU, and the computer that runs the service."""

from baqueano.diagnostics import StopReason as S

ENCODER_HELP = (
    "Does that wheel turn? If it does, check its encoder: 5 V, ground, wire A. Without an encoder type, with the "
    "ssh name of the vehicle as HOST: {fix}"
)
MISSION_ENDED_TEXT = "the service ended in the middle of a mission: {kind}, recorded in {run}, with {blocks}."
BLOCK_ENDED_TEXT = "One of its blocks ended, crashed or blocked the program, or the service was killed"
IMU_RESET_ADVICE = (
    "Disconnect the IMU's supply for a second. If that does not help, SDA (pin 3) and SCL (pin 5) touch ground or each "
    "other."
)

TEMPLATES: dict[str, str] = {
    S.UNO_LATCHED: "the emergency stop of the Uno is latched. Look at the vehicle, then type: {fix}",
    S.UNO_BATTERY: "the battery is at {battery_v:.2f} V, less than least_battery_v",
    S.UNO_RESET: "the Uno was reset ({cause:word}): the motors are off until it is armed again",
    S.UNO_DEAD_MAN: "the Uno received no command for {silent_ms:g} ms and stopped the motors",
    S.UNO_DISARMED: "the Uno is no longer armed",
    S.UNO_DEAF: (
        "the Uno did not confirm ARM within {arming_ms:g} ms: it does not receive. Check its cable, and the capacitors "
        "across the motors"
    ),
    S.UNO_SILENT: "the Uno has been silent for {silent_ms:.0f} ms",
    S.UNO_UNHEARD: "the Uno has not sent anything yet",
    S.UNO_ABSENT: "the Uno does not answer: is its cable plugged in?",
    S.LINE_NOISY: (
        "no complete frame has come from the Uno for {silent_ms:.0f} ms: the line is noisy. Check its cable, and the "
        "capacitors across the motors"
    ),
    S.STANDSTILL: (
        "the computer did not respond for {silent_s:g} s; the motors were off after the first {dead_man_s:g} s"
    ),
    S.TEMPERATURE: (
        "the computer is at {temperature_c:.0f} °C: the limit max_temperature_c is {max_temperature_c:g}"
    ),
    S.DISK_FULL: (
        "the disk has {free_mb:.0f} MB free, less than least_disk_mb = {min_disk_mb:g}. Delete old runs"
    ),
    S.TILT: "the vehicle is tilted by {tilt_deg:.0f}°: max_tilt_rad is {max_tilt_rad:g}",
    S.BATTERY: (
        "the battery has had less than least_battery_v = {min_battery_v:g} V for {low_s:g} s: {battery_v:.2f} V. "
        "Charge it"
    ),
    S.IMU_ABSENT: "the IMU is missing: {cause}",
    S.IMU_SILENT: "the IMU does not answer: check its four wires",
    S.IMU_BUS_BLOCKED: (
        "the IMU is silent: its I2C bus is stuck low. Clock pulses will free it while the vehicle is at rest"
    ),
    S.IMU_BUS_STILL_BLOCKED: f"the IMU is silent: {{cause}}. {IMU_RESET_ADVICE}",
    S.SERVICE_ENDED: "another process ended the service",
    S.MISSION_UNFINISHED: f"{MISSION_ENDED_TEXT} {BLOCK_ENDED_TEXT}",
    S.MISSION_UNFINISHED_AT: f"{MISSION_ENDED_TEXT} It was at {{file}} line {{line}}. {BLOCK_ENDED_TEXT}",
    S.NOT_CHECKED: "the hardware has not been checked yet",
    S.CHECKED_AGAIN: "the vehicle was stopped, and is being checked again",
    "error.BaqueanoError": "{words}",
    "error.AnswerNo": "{words}",
    "error.UsageError": "{words}",
    "error.FileError": "{words}",
    "error.RobotUnreachable": "{words}",
    "error.SafetyStop": "{words}",
    "block.raised-outside": "{place} raised {error}",
    "service.unexpected-error": "{error}",
    "calibration.stopped": "The calibration was stopped: {cause}.",
    "hardware.note": "{words}",
    "imu.answers": "the IMU answers now",
    "imu.held": (
        "The I2C bus is stuck low. While the vehicle is at rest, nine clock pulses are sent on SCL as a "
        "GPIO. They free the bus if a chip stopped in the middle of a byte. If that does not help, "
        "disconnect the IMU's supply for a second."
    ),
    "imu.answers-again": "The IMU is back after {silent_s:.2f} s.",
    "imu.data-missing": "No data from the IMU for {silent_s:g} s{cause}.",
    "imu.frozen": "The IMU repeated the same data {count} times.",
    "imu.saturated": "The IMU's {axis:word} (the chip's axis) is at full scale, {range}.",
    "imu.overflow": "The FIFO was {state:word} with {count} bytes, and was emptied.",
    "imu.started": "The IMU runs again.",
    "imu.restart": "The IMU is restarted.",
    "imu.lost-supply": (
        "The IMU lost its supply for a moment (PWR_MGMT_1 0x{power:02X}, settings {value}, "
        "expected {expected}). It is restarted."
    ),
    "imu.lost-settings": (
        "The IMU lost its settings (PWR_MGMT_1 0x{power:02X}, settings {value}, expected "
        "{expected}). It is restarted."
    ),
    "imu.settings-not-stored": (
        "The IMU did not store its settings: it answers {value}, expected {expected}. Disconnect its supply for a "
        "second."
    ),
    "imu.bus-unusable": f"{{path}} is stuck low, so no device can answer. {{cause}}. {IMU_RESET_ADVICE}",
    "bus.scl-held": "SCL (GPIO 3) is stuck low, so clock pulses cannot free the bus.",
    "bus.scl-held-later": (
        "SCL (GPIO 3) is stuck low after {clocks} clock pulses, so more pulses cannot be sent."
    ),
    "bus.sda-held": "SDA (GPIO 2) is still low after {clocks} clock pulses.",
    "bus.pins-restored": (
        "GPIO 2 and 3 were not in I2C mode, probably because a program was killed. They were set back to "
        "I2C mode."
    ),
    "bus.no-pinctrl": (
        "The program pinctrl, which can free the bus, is missing. On a Raspberry Pi type: {fix}"
    ),
    "bus.free": "SDA and SCL are high, so the bus is free, and no clock pulses were sent.",
    "bus.freed-at-once": (
        "A chip blocked the I2C bus in the middle of a byte: the bus was freed after 1 clock pulse."
    ),
    "bus.freed": (
        "A chip blocked the I2C bus in the middle of a byte: the bus was freed after {clocks} clock pulses."
    ),
    "encoders.both-silent": (
        "both encoders count nothing, although both motors have a high command. Do the wheels turn? If they do, "
        "check the encoders: 5 V, ground, wire A. Without encoders type, with the ssh name of "
        "the vehicle as HOST: {fix}"
    ),
    "encoders.left-silent": f"the left encoder counts nothing, although its motor has a high command. {ENCODER_HELP}",
    "encoders.right-silent": f"the right encoder counts nothing, although its motor has a high command. {ENCODER_HELP}",
    "drive.ticks": (
        "{ticks} ticks: the latest started {worst_ms:.1f} ms late, {late_ticks} were more than half a "
        "period late, {skipped_ticks} were skipped"
    ),
    "drive.line": (
        "commands to the Uno: {sent_commands} were sent, {unsent_commands} were not. Frames "
        "from the Uno: {received_frames} were received, {lost_frames} lost, {late_frames} "
        "repeated or too late, and {damaged_frames} damaged. The Uno was reset {resets} times"
    ),
    "drive.line-stopped": (
        "commands to the Uno: {sent_commands} were sent, {unsent_commands} were not. Frames "
        "from the Uno: {received_frames} were received, {lost_frames} lost, {late_frames} "
        "repeated or too late, and {damaged_frames} damaged. The Uno was reset {resets} "
        "times. {cause}"
    ),
    "drive.uno": (
        "the Uno received {received_frames} frames: {damaged_frames} were damaged ({damage_percent:.1f} %) and "
        "{ignored_frames} ignored; its receiver lost {lost_bytes} bytes"
    ),
    "drive.imu": (
        "the IMU gave {samples} samples, {full_scale_samples} of them at full scale; {repeated_samples} more only "
        "repeated the previous one and were excluded. {retries} transfers were repeated, {failures} "
        "failed, the FIFO was emptied {overflows} times, and the IMU restarted {restarts} times"
    ),
}
