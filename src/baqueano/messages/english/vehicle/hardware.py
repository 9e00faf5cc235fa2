"""English sentences about the hardware: bus, IMU, Uno, its card, its setup and its calibration."""

REMEDY = (
    "Is it an Uno, with its own boot-loader, and is nothing plugged into D0 and D1? Press its reset button once, and "
    "type it again."
)

TEMPLATES: dict[str, str] = {
    "emulated.no-source": (
        "--robot emulated: the emulated vehicle is in the source tree, not in the package. Type: git clone, then "
        "make demo there, and .venv/bin/baqueano"
    ),
    "emulated.no-packages": "--robot emulated: the emulator needs Debian packages. Type: {fix}",
    "bus.pinctrl-said": "pinctrl get {pins} answered {found}: expected one line per pin.",
    "bus.pinctrl-refused": "pinctrl set {pin} {options} answered: {said}",
    "bus.not-given-back": "GPIO 2 and 3 could not be given back to I2C{because}. Type: {fix}",
    "bus.too-late": "{command} was not finished within {all_s:g} s. Type: {fix}",
    "bus.call-failed": "{command} failed: {error}",
    "bus.call-refused": (
        "{command} failed ({exit}): {said}. Is this user in the group gpio? Type: sudo usermod -aG gpio $USER, "
        "and log in again."
    ),
    "bus.not-this": "{path} is not /dev/{bus}, so its pins are unknown.",
    "bus.other-pins": (
        "GPIO 2 is {sda} and GPIO 3 {scl}, expected {expected}: on this board they are not those of i2c-bcm2835, "
        "and were not touched."
    ),
    "imu.chip": "IMU: {chip} (WHO_AM_I {who_am_i})",
    "imu.too-few-samples": (
        "The IMU at 0x{address:02X} on {path} answers, but gave {count} samples in {within_s} s: {events}"
    ),
    "imu.unknown-chip": (
        "The device at 0x{address:02X} answers 0x{who_am_i:02X} to WHO_AM_I, which is an unknown "
        "chip, and it {odd}. Put the vehicle at rest and try again; else try another IMU."
    ),
    "imu.no-bus": (
        "{path} is missing: I2C is off, or this computer is not the robot (from a laptop, end "
        "the line with its HOST). On a Raspberry Pi write "
        "dtparam=i2c_arm=on,i2c_arm_baudrate=400000 into /boot/firmware/config.txt, and restart "
        "it."
    ),
    "imu.bus-not-allowed": "{path} may not be opened by this user. Type: sudo usermod -aG i2c $USER, and log in again.",
    "imu.no-smbus": (
        "I2C needs Linux and smbus2, and one is missing here. On the robot type: pip install smbus2. On a laptop "
        "use --robot HOST or --robot simulated."
    ),
    "imu.no-answer": (
        "No IMU answers at {asked} on {path}. Check VCC to pin 1 (3.3 V), GND to 6, SDA to 3, SCL to 5; "
        "i2cdetect -y 1 shows what answers."
    ),
    "imu.no-chip": (
        "The device at 0x{address:02X} on {path} answers 0x{who_am_i:02X} to WHO_AM_I: a damaged "
        "wire or a damaged chip. Check the wires, then try another IMU."
    ),
    "imu.self-test-broke-off": "The self-test of the IMU broke off: {error}. Check the wires and repeat.",
    "imu.self-test-moved": (
        "The vehicle moved during the self-test: {axis:word} scattered by {scatter:.3g} {in_unit}, expected less than "
        "{limit:g}. Put it down, motors off, and repeat."
    ),
    "imu.axes": (
        "IMU axes = {axes}: expected the chip's axes that point ahead, left and up. Each letter "
        'appears once, and a mirror image is not possible: ("x", "y", "z"), or ("x", "-y", "-z") '
        "for a chip upside down."
    ),
    "imu.setting": "IMU {name} = {value}: expected one of {words}.",
    "service.no-run-there": "{folder} cannot take a run: {error}. Type: {fix}",
    "service.hundred-runs": "{folder} has a hundred runs of this second.",
    "card.cards": (
        "{cards} cards with a partition bootfs are mounted here. Write Raspberry Pi OS Lite (64-bit) on one, "
        "plug it in again, and name the folder of its small partition: baqueano robot card /media/you/bootfs"
    ),
    "card.no-boot": (
        "{folder} is not a boot partition of a Raspberry Pi: expected cmdline.txt and config.txt in it. "
        "It is the small partition of the card, called bootfs."
    ),
    "card.no-public-key": (
        "{place} is not a public ssh key: expected one line, ssh-ed25519 AAAA… The file ends in .pub."
    ),
    "card.no-key": "an ssh key is missing: looked for {known}. Type: ssh-keygen -t ed25519, and this again",
    "card.name": "--name {name}: expected small letters, digits and - between them, 63 at most: robot-1",
    "card.user": "--user {user}: expected small letters and digits, a letter first, and not root: ana",
    "card.network-name": "the network's name has {bytes} bytes, expected 1 to 32.",
    "card.network-password": "the network's password has {letters} letters, expected 8 to 63 of ASCII.",
    "card.country": (
        "--country {country}: expected two capital letters, such as AR, DE, US. "
        "Without a country the Wi-Fi stays off."
    ),
    "setup.file-not-read": "{host}: {path} could not be read, for the reason above. Type: {fix}",
    "setup.no-place-for-calibration": (
        "{host}: {key} = {found} was calibrated there, but your vehicle file does not have the "
        "table of that key. Add the table; or, to lose the calibration: ssh {host} rm {path}"
    ),
    "setup.no-answer": (
        "{host} did not answer over ssh. Is it on, in this network, and does it know your key? Type: {fix}"
    ),
    "setup.32-bit": (
        "{host} is a {computer}: numpy does not exist as a package for 32-bit systems. Write the "
        "64-bit Raspberry Pi OS Lite on its card (for a Pi 3, 4, 5 or Zero 2), and: baqueano "
        "robot card"
    ),
    "setup.old-python": (
        "{host} has Python {major}.{minor}, expected {least_major}.{least_minor} or newer. Write a newer "
        "Raspberry Pi OS on its card (Bookworm or later)."
    ),
    "setup.packages": (
        "the robot's packages could not be collected: {said} This computer needs the internet "
        "once for each kind of robot."
    ),
    "setup.packages-not-sent": "{host}: the packages could not be sent, for the reason above. Is its card full?",
    "setup.nothing-sent": "{host}: nothing could be sent there, for the reason above.",
    "setup.not-finished": (
        "{host}: the setup was not finished, for the reason above; its steps so far are noted "
        "there. Type the line again, or undo it: baqueano robot remove {host}"
    ),
    "uno.number-range": "{frame}.{path} = {number}: the firmware takes {least} to {most}. Give a value in that range.",
    "flash.bad-line": "{path}: line {line} is damaged, or is not from an Intel hex file.",
    "flash.not-hex": "{path} cannot be read as an Intel hex file: {error}.",
    "flash.size": "{path} holds {bytes} bytes: expected 1 to {most_bytes}, what an Uno has room for.",
    "flash.no-avrdude": (
        "avrdude is not installed here. Type: sudo apt-get install avrdude. Without internet, plug the "
        "Uno into a computer that has it, and type there: baqueano robot flash"
    ),
    "flash.too-slow": f"{{where}}: avrdude was not done after {{within_s:g}} s. {REMEDY}",
    "flash.failed": f"{{where}}: avrdude could not write it: {{said}} {REMEDY}",
    "uno.refused-number": "the Uno rejected the settings: sent {question}, stored {said}.",
    "uno.answer-not-whole": (
        "the Uno's answer to {question} was not complete within {within_s:g} s: the line is "
        "noisy. Check its cable, and the capacitors across the motors"
    ),
    "uno.no-answer": (
        "the Uno did not answer {question} within {within_s:g} s: is it powered, and is our firmware on it? "
        "Type: {fix}"
    ),
    "uno.protocol": "the firmware at {path} has protocol {theirs}, this baqueano {ours}. Type: {fix}",
    "uno.no-line": (
        "no serial line of an Uno was found: neither /dev/serial/by-id/* nor /dev/ttyACM*, /dev/ttyUSB*. Is its "
        "USB cable plugged in, and does it carry data? Or name the line: [robot] port"
    ),
    "uno.several-lines": (
        'there are {count} serial lines: {lines}. Name one in the vehicle file: [robot] port = "{first}"'
    ),
    "settings.way": (
        "--{option} {found}: expected a wheel and direction with its number, as left-forwards=0.9; wheels and "
        "directions are {known} and all."
    ),
    "settings.word": "--{option} {found}: expected one of {known}.",
    "settings.number": "--{option} {found}: expected a number from {least:g} to {most:g}.",
    "settings.motor-runs": (
        "a motor runs (left {left:+.0%}, right {right:+.0%} of full duty): expected both at rest. Nothing was "
        "stored. Stop the vehicle, and type it again."
    ),
    "calibrate.no-sample": "the IMU gave no sample in {within_s:g} s: look at its four wires. Type: {fix}",
    "calibrate.not-still": (
        "{what:word}: the vehicle moved during {within_s:g} s. Put it down, let it go, and try again."
    ),
    "calibrate.not-felt": (
        "{what:word}: the IMU measured nothing of this within {within_s:g} s. Type the same line again."
    ),
    "calibrate.turned-right": (
        "The vehicle was turned by {turned_deg:.0f}° to the right. Turn it to the left: seen "
        "from above, counter-clockwise. If that was done, the axes of gyro and accelerometer "
        "disagree: try another IMU."
    ),
    "calibrate.not-upright": (
        "At rest the chip measures ({x:.1f}, {y:.1f}, {z:.1f}) m/s²: every axis is more than 25° "
        "from the vertical. Mount it flat or on edge, and type the same line again."
    ),
    "calibrate.lifted-over-corner": (
        "The vehicle was lifted over a corner: gravity changed by {first_m_s2:.1f} m/s² along "
        "one axis of the chip and by {second_m_s2:.1f} along another, expected less than "
        "{clear:.2f} of it. Lift the front straight up. A chip at 45° does not have an axis that "
        "points ahead: turn it on the vehicle."
    ),
    "calibrate.motor-does-not-turn": (
        "motor {side:word}, {direction:word}: the vehicle did not turn even at full duty. Is the battery on, are the "
        "motor's two wires and its enable pin (D9 left, D10 right) plugged in?"
    ),
    "calibrate.no-push": (
        "With both motors on, the IMU measured a change of speed of {push_m_s:.2f} m/s in "
        "{push_s:g} s, too little to distinguish ahead from back. Is the way free? Does [robot] "
        "imu_axes name the axis that points ahead? Type: {fix}"
    ),
    "calibrate.few-duties": (
        "{name}: of {duties} duties from {low:.0%} to {high:.0%} only {moved} turned the wheel, "
        "expected 4 or more. Does the wheel slip? Is the battery low?"
    ),
    "calibrate.dead-zone": (
        "{name}: the wheel does not turn below a duty of {dead_zone:.0%}, and the firmware "
        "compensates 70 % at most. Charge the battery, or check what brakes the wheel."
    ),
    "hardware.service-has-it": (
        "the service uses the hardware, and this user may not stop it ({error}). Type: {fix}"
    ),
    "hardware.drives": (
        "the vehicle drives ({state}), and this command needs the hardware for itself. Wait "
        "until the drive is over, or end it: baqueano robot stop"
    ),
    "floor.not-still": (
        "the vehicle does not stand still with its motors off: the gyro scatters by {scatter_deg_s:.1f} °/s. Put "
        "it on a level floor and leave it alone."
    ),
    "floor.gravity": (
        "the IMU measures ({x:.1f}, {y:.1f}, {z:.1f}) m/s² ahead, left and up, expected (0, 0, "
        "9.8): the vehicle lies on its side, or [robot] imu_axes is wrong. Type: {fix}"
    ),
}
