"""English sentences about the hardware: bus, IMU, Uno, its card, its setup and its calibration."""

UNO_REMEDY = (
    "Is it an Uno with its own boot-loader? Are D0 and D1 unconnected? Press its reset button once, and type the same "
    "line again."
)

TEMPLATES: dict[str, str] = {
    "emulated.no-source": (
        "--robot emulated: the emulated vehicle is in the source tree, not in the package. In a clone of the "
        "repository type make demo, and then use .venv/bin/baqueano from there"
    ),
    "emulated.no-packages": "--robot emulated: the emulator needs Debian packages. Type: {fix}",
    "bus.pinctrl-answer": "pinctrl get {pins} answered {value}: expected one line per pin.",
    "bus.pinctrl-refused": "pinctrl set {pin} {options} answered: {reply}",
    "bus.pins-not-restored": "GPIO 2 and 3 could not be set back to I2C mode{cause}. Type: {fix}",
    "bus.too-late": "{command} did not finish within {limit_s:g} s. Type: {fix}",
    "bus.call-failed": "{command} failed: {error}",
    "bus.call-refused": (
        "{command} failed ({exit}): {reply}. Is this user in the group gpio? Type: sudo usermod -aG gpio $USER, "
        "and log in again."
    ),
    "bus.other-bus": "{path} is not /dev/{bus}, so its pins are unknown.",
    "bus.other-pins": (
        "GPIO 2 is {sda} and GPIO 3 is {scl}; expected: {expected}. On this board these pins do not "
        "belong to i2c-bcm2835, so they were not changed."
    ),
    "imu.chip": "IMU: {chip} (WHO_AM_I {who_am_i})",
    "imu.too-few-samples": (
        "The IMU at 0x{address:02X} on {path} answers, but gave {count} samples in {limit_s} s: {events}"
    ),
    "imu.unknown-chip": (
        "The device at 0x{address:02X} answers 0x{who_am_i:02X} to WHO_AM_I, which is an unknown chip, and "
        "it {fault}. Put the vehicle at rest and try again. If the error remains, try another IMU."
    ),
    "imu.no-bus": (
        "{path} is missing: I2C is off, or this computer is not the robot (on a laptop, add the robot's "
        "HOST to the line). On a Raspberry Pi write dtparam=i2c_arm=on,i2c_arm_baudrate=400000 into "
        "/boot/firmware/config.txt, and restart it."
    ),
    "imu.bus-not-allowed": (
        "This user is not allowed to open {path}. Type: sudo usermod -aG i2c $USER, and log in again."
    ),
    "imu.no-smbus": (
        "I2C needs Linux and smbus2, but one of them is missing here. On the robot type: pip install "
        "smbus2. On a laptop use --robot HOST or --robot simulated."
    ),
    "imu.no-answer": (
        "No IMU answers at {address_range} on {path}. Check VCC to pin 1 (3.3 V), GND to 6, SDA to 3, SCL to 5; "
        "i2cdetect -y 1 shows what answers."
    ),
    "imu.no-chip": (
        "The device at 0x{address:02X} on {path} answers 0x{who_am_i:02X} to WHO_AM_I: a wire or the chip "
        "is damaged. Check the wires, then try another IMU."
    ),
    "imu.self-test-broke-off": (
        "The self-test of the IMU was interrupted: {error}. Check the wires and repeat."
    ),
    "imu.self-test-moved": (
        "The vehicle moved during the self-test: {axis:word} varied by {scatter:.3g} {unit_name}; expected "
        "less than {limit:g}. Put it down with the motors off, and repeat."
    ),
    "service.no-run-there": "A run cannot be written into {folder}: {error}. Type: {fix}",
    "service.hundred-runs": "{folder} already contains a hundred runs that began in this second.",
    "card.cards": (
        "cards with a partition bootfs that are mounted here: {cards}; expected 1. Write Raspberry Pi OS Lite "
        "(64-bit) on one card, and plug it in again. Then name the folder of its small partition: baqueano robot card "
        "/media/you/bootfs"
    ),
    "card.no-boot": (
        "{folder} is not a boot partition of a Raspberry Pi: expected cmdline.txt and config.txt in it. "
        "It is the small partition of the card, called bootfs."
    ),
    "card.no-public-key": (
        "{place} is not a public ssh key: expected one line, ssh-ed25519 AAAA… The name of such a file "
        "ends in .pub."
    ),
    "card.no-key": (
        "An ssh key was not found; places searched: {valid}. Type: ssh-keygen -t ed25519. Then repeat the "
        "command"
    ),
    "card.name": (
        "--name {name}: expected at most 63 lower-case letters and digits, with hyphens only between them, "
        "such as robot-1"
    ),
    "card.user": (
        "--user {user}: expected lower-case letters and digits, first a letter, and not root, for example ana"
    ),
    "card.network-name": "The network's name has {bytes} bytes; expected 1 to 32.",
    "card.network-password": (
        "The network's password has {letters} characters; expected 8 to 63 ASCII characters."
    ),
    "card.country": (
        "--country {country}: expected two capital letters, such as AR, DE, US. "
        "Without a country the Wi-Fi stays off."
    ),
    "setup.file-not-read": "{host}: {path} could not be read, for the reason above. Type: {fix}",
    "setup.no-place-for-calibration": (
        "{host}: {key} = {value} was calibrated there, but your vehicle file does not have the table of "
        "that key. Add the table. Or, to delete the calibration: {ssh} rm {path}"
    ),
    "setup.no-answer": (
        "{host} did not answer over ssh. Is it on? Is it in this network? Does it have your ssh key? Type: "
        "{fix}"
    ),
    "setup.32-bit": (
        "{host} is a {computer}: numpy does not exist as a package for 32-bit systems. Write the "
        "64-bit Raspberry Pi OS Lite on its card (for a Pi 3, 4, 5 or Zero 2), and: baqueano "
        "robot card"
    ),
    "setup.old-python": (
        "{host} has Python {major}.{minor}, expected {min_major}.{min_minor} or newer. Write a newer "
        "Raspberry Pi OS on its card (Bookworm or later)."
    ),
    "setup.packages": (
        "The robot's packages could not be collected: {reply} This computer needs the internet "
        "once for each kind of robot."
    ),
    "setup.packages-not-sent": "{host}: the packages could not be sent, for the reason above. Is its card full?",
    "setup.nothing-sent": "{host}: the files could not be sent, for the reason above.",
    "setup.not-finished": (
        "{host}: the setup was not finished, for the reason above. The steps done so far are recorded "
        "there. Type the line again, or undo them: baqueano robot remove {host}"
    ),
    "uno.number-range": (
        "{frame}.{path} = {number}: the firmware accepts {minimum} to {maximum}. Give a value in that range."
    ),
    "flash.bad-line": "{path}: line {line} is damaged, or is not from an Intel hex file.",
    "flash.not-hex": "{path} cannot be read as an Intel hex file: {error}.",
    "flash.size": "{path} contains {bytes} bytes: expected 1 to {max_bytes}, the limit of an Uno.",
    "uno.port-not-allowed": (
        "{user} is not allowed to open {path}: this port belongs to the group dialout. Type: {fix}, and "
        "log in again"
    ),
    "uno.port-in-use": (
        "{path} is in use by another program: only one program can drive the vehicle. Type: {fix}"
    ),
    "uno.port-not-opened": "{path} cannot be opened: {error}. Is the cable plugged in? Type: {fix}",
    "ssh.no-baqueano": "baqueano is not installed on {host}. Type: {fix}",
    "ssh.not-reached": "{host} cannot be reached by ssh. To see why: {fix}",
    "ssh.other-version": (
        "{host}: the answer to baqueano {verb} has another form, as of another version of baqueano. Type: {fix}"
    ),
    "ssh.ended": "{host}: baqueano {verb} ended there, for the reason above.",
    "flash.no-avrdude": (
        "avrdude is not installed here. Type: sudo apt-get install avrdude. Without internet, connect the "
        "Uno to a computer that has avrdude, and type there: baqueano robot flash"
    ),
    "flash.too-slow": f"{{port}}: avrdude did not finish within {{limit_s:g}} s. {UNO_REMEDY}",
    "flash.failed": f"{{port}}: avrdude could not write the firmware: {{reply}} {UNO_REMEDY}",
    "uno.refused-number": "The Uno rejected the settings: sent {question}, stored {reply}.",
    "uno.answer-not-whole": (
        "The Uno's answer to {question} was not complete within {limit_s:g} s: the line is "
        "noisy. Check its cable, and the capacitors across the motors"
    ),
    "uno.no-answer": (
        "The Uno did not answer {question} within {limit_s:g} s: is it powered? Does it have our "
        "firmware? Type: {fix}"
    ),
    "uno.protocol": (
        "The firmware at {path} has protocol {firmware_protocol}, but this baqueano has {package_protocol}. Type: "
        "{fix}"
    ),
    "uno.no-line": (
        "No serial line of an Uno was found: neither /dev/serial/by-id/* nor /dev/ttyACM*, /dev/ttyUSB*. "
        "Is its USB cable connected? Does the cable carry data? Or name the line: [robot] port"
    ),
    "uno.several-lines": (
        'There are {count} serial lines: {lines}. Name one in the vehicle file: [robot] port = "{first}"'
    ),
    "settings.wheel-direction": (
        "--{option} {value}: expected a wheel and direction with a number, such as left-forwards=0.9; "
        "wheels and directions are {valid} and all."
    ),
    "settings.choice": "--{option} {value}: expected one of {valid}.",
    "settings.number": "--{option} {value}: expected a number from {minimum:g} to {maximum:g}.",
    "settings.motor-runs": (
        "A motor runs (left {left:+.0%}, right {right:+.0%} of full duty): expected both at rest. Nothing "
        "was stored. Stop the vehicle, and type the same line again."
    ),
    "calibrate.no-sample": (
        "The IMU did not give a sample in {limit_s:g} s: check its four wires. Type: {fix}"
    ),
    "calibrate.not-still": (
        "{step:word}: the vehicle moved during {limit_s:g} s. Put it down, do not touch it, and try again."
    ),
    "calibrate.no-motion": (
        "{step:word}: the IMU did not measure this motion within {limit_s:g} s. Type the same line again."
    ),
    "calibrate.turned-right": (
        "The vehicle was turned by {turn_deg:.0f}° to the right. Turn it to the left (counter-clockwise, "
        "seen from above). If you did that, the axes of gyro and accelerometer disagree: try another IMU."
    ),
    "calibrate.not-upright": (
        "At rest the chip measures ({x_m_s2:.1f}, {y_m_s2:.1f}, {z_m_s2:.1f}) m/s²: every axis is more than 25° "
        "from the vertical. Mount it flat or on edge, and type the same line again."
    ),
    "calibrate.lifted-over-corner": (
        "The vehicle was lifted over a corner. Gravity changed by {first_m_s2:.1f} m/s² along one axis "
        "of the chip and by {second_m_s2:.1f} along another. Expected a ratio below {max_ratio:.2f}. Lift "
        "the front straight up. A chip at 45° does not have an axis that points forward: turn it on the "
        "vehicle."
    ),
    "calibrate.motor-does-not-turn": (
        "motor {side:word}, {direction:word}: the vehicle did not turn even at full duty. Is the battery "
        "on? Are the motor's two wires and its enable pin (D9 left, D10 right) connected?"
    ),
    "calibrate.no-push": (
        "With both motors on, the IMU measured a change of speed of {push_m_s:.2f} m/s in {push_s:g} s. "
        "This is too little to distinguish forward from backward. Is the path free? Does [robot] imu_axes "
        "name the axis that points forward? Type: {fix}"
    ),
    "calibrate.few-duties": (
        "{name}: {duties} duties from {low:.0%} to {high:.0%} were tried, and only {count} of them turned "
        "the wheel; expected 4 or more. Does the wheel slip? Is the battery low?"
    ),
    "calibrate.dead-zone": (
        "{name}: the wheel does not turn below a duty of {dead_zone:.0%}, but the firmware compensates 70 "
        "% at most. Charge the battery, or check what brakes the wheel."
    ),
    "hardware.used-by-service": (
        "The service uses the hardware, and this user is not allowed to stop it ({error}). Type: {fix}"
    ),
    "hardware.drives": (
        "The vehicle is driving ({state}), and this command needs exclusive use of the hardware. Wait "
        "until the drive is over, or end it: baqueano robot stop"
    ),
    "floor.not-still": (
        "The vehicle is not at rest, although its motors are off: the gyro varies by {scatter_deg_s:.1f} "
        "°/s. Put it on a level floor and do not touch it."
    ),
    "floor.gravity": (
        "The IMU measures ({x_m_s2:.1f}, {y_m_s2:.1f}, {z_m_s2:.1f}) m/s² forward, left and up; expected (0, 0, 9.8). "
        "The vehicle lies on its side, or [robot] imu_axes is wrong. Type: {fix}"
    ),
}
