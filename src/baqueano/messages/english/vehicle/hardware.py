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
    "bus.pinctrl-said": "pinctrl get {pins} said {found}, expected a line for each of the two.",
    "bus.pinctrl-refused": "pinctrl set {pin} {options} said: {said}",
    "bus.not-given-back": "GPIO 2 and 3 could not be given back to I2C{because}. Type: {fix}",
    "bus.too-late": "{command} came too late: {all_s:g} s were over. Type: {fix}",
    "bus.call-failed": "{command} did not end well: {error}",
    "bus.call-refused": (
        "{command} failed ({exit}): {said}. Is this user in the group gpio? Type: sudo usermod -aG gpio $USER, "
        "and log in again."
    ),
    "bus.not-this": "{path} is not /dev/{bus}: on which pins it is, is not known.",
    "bus.other-pins": (
        "GPIO 2 is {sda} and GPIO 3 {scl}, expected {expected}: on this board they are not those of i2c-bcm2835, "
        "and were not touched."
    ),
    "imu.chip": "IMU: {chip} (WHO_AM_I {who_am_i})",
    "imu.too-few-samples": (
        "The IMU at 0x{address:02X} on {path} answers, but gave {count} samples in {within_s} s: {events}"
    ),
    "imu.unknown-chip": (
        "What answers 0x{who_am_i:02X} to WHO_AM_I at 0x{address:02X} is not a chip that is known, and it {odd}. "
        "Put the vehicle at rest and try again; else try another IMU."
    ),
    "imu.no-bus": (
        "{path} is missing: I2C is off, or this is not the robot: from a laptop end the line in its "
        "HOST. On a Raspberry Pi put dtparam=i2c_arm=on,i2c_arm_baudrate=400000 into "
        "/boot/firmware/config.txt, and start it again."
    ),
    "imu.bus-not-allowed": (
        "{path} may not be opened by this user. Type: sudo usermod -aG i2c $USER, and log in again."
    ),
    "imu.no-smbus": (
        "I2C needs Linux and smbus2, and one is missing here. On the robot type: pip install smbus2. On a laptop "
        "use --robot HOST or --robot simulated."
    ),
    "imu.no-answer": (
        "No IMU answers at {asked} on {path}. Check VCC to pin 1 (3.3 V), GND to 6, SDA to 3, SCL to 5; "
        "i2cdetect -y 1 shows what answers."
    ),
    "imu.no-chip": (
        "What answers at 0x{address:02X} on {path} says 0x{who_am_i:02X} to WHO_AM_I: a broken line or a broken "
        "chip. Check the wires, then try another IMU."
    ),
    "imu.self-test-broke-off": "The self-test of the IMU broke off: {error}. Check the wires and repeat.",
    "imu.self-test-moved": (
        "The vehicle moved during the self-test: {axis:word} scattered by {scatter:.3g} {in_unit}, expected less than "
        "{limit:g}. Put it down, motors off, and repeat."
    ),
    "imu.axes": (
        "IMU axes = {axes}: expected the chip's axes that point ahead, left and up. Each letter stands "
        'once, without a mirror image, as ("x", "y", "z") or ("x", "-y", "-z") for a chip upside down.'
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
        "{place} is not a public ssh key: expected one line, ssh-ed25519 AAAA… It ends in .pub."
    ),
    "card.no-key": "an ssh key is missing: looked for {known}. Type: ssh-keygen -t ed25519, and this again",
    "card.name": "--name {name}: expected small letters, digits and - between them, 63 at most: robot-1",
    "card.user": "--user {user}: expected small letters and digits, a letter first, and not root: ana",
    "card.network-name": "the network's name has {bytes} bytes, expected 1 to 32.",
    "card.network-password": "the network's password has {letters} letters, expected 8 to 63 of ASCII.",
    "card.country": "--country {country}: expected two capital letters, as AR, DE, US: Wi-Fi is off without.",
    "setup.file-not-read": "{host}: {path} could not be read, for the reason above. Type: {fix}",
    "setup.no-place-for-calibration": (
        "{host}: {key} = {found} was calibrated there, and your vehicle file cannot hold it: expected "
        "the table of that key. Put it in; or, to lose the calibration: ssh {host} rm {path}"
    ),
    "setup.no-answer": (
        "{host} did not answer over ssh. Is it on, in this network, and does it know your key? Type: {fix}"
    ),
    "setup.32-bit": (
        "{host} is a {computer}: numpy lacks a wheel for 32-bit systems. Write the 64-bit Raspberry Pi "
        "OS Lite on its card (a Pi 3, 4, 5 or Zero 2 runs it), and: baqueano robot card"
    ),
    "setup.old-python": (
        "{host} has Python {major}.{minor}, expected {least_major}.{least_minor} or newer. Write a newer "
        "Raspberry Pi OS on its card (Bookworm or later)."
    ),
    "setup.packages": (
        "the robot's packages could not be put together: {said} This computer needs the internet for it, once "
        "for each kind of robot."
    ),
    "setup.packages-not-sent": (
        "{host}: the packages could not be sent, for the reason above. Is its card full?"
    ),
    "setup.nothing-sent": "{host}: nothing could be sent there, for the reason above.",
    "setup.not-finished": (
        "{host}: it was not finished, for the reason above; what was done is noted there. Type it again, or take "
        "it back: baqueano robot remove {host}"
    ),
    "uno.number-range": (
        "{frame}.{path} = {number}: the firmware takes {least} to {most}. Give a value in that range."
    ),
    "flash.bad-line": "{path}: line {line} is damaged, or is not from an Intel hex file.",
    "flash.not-hex": "{path}: no Intel hex file can be read there: {error}.",
    "flash.size": "{path} holds {bytes} bytes: expected 1 to {most_bytes}, what an Uno has room for.",
    "flash.no-avrdude": (
        "avrdude is not installed here. Type: sudo apt-get install avrdude. Without internet, plug the "
        "Uno into a computer that has it, and type there: baqueano robot flash"
    ),
    "flash.too-slow": f"{{where}}: avrdude was not done after {{within_s:g}} s. {REMEDY}",
    "flash.failed": f"{{where}}: avrdude did not write it: {{said}} {REMEDY}",
    "uno.refused-number": "the Uno rejected the settings: sent {question}, stored {said}.",
    "uno.answer-not-whole": (
        "the Uno's answer to {question} did not come whole within {within_s:g} s: the line is noisy. Look at its "
        "cable, and at the capacitors across the motors"
    ),
    "uno.no-answer": (
        "the Uno did not answer {question} within {within_s:g} s: is it powered, and is our firmware on it? "
        "Type: {fix}"
    ),
    "uno.protocol": "the firmware at {path} speaks protocol {theirs}, this baqueano {ours}. Type: {fix}",
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
        "{what:word}: the vehicle was not still within {within_s:g} s. Put it down, let it go, and try again."
    ),
    "calibrate.not-felt": "{what:word}: nothing of that was felt within {within_s:g} s. Type the same line again.",
    "calibrate.turned-right": (
        "it was turned by {turned_deg:.0f}° to the right, or its gyro is a mirror image of its accelerometer, as "
        "in no chip that is known. Seen from above to the left is against the clock: try again."
    ),
    "calibrate.not-upright": (
        "at rest the chip feels ({x:.1f}, {y:.1f}, {z:.1f}) m/s²: none of its axes is within 25° of upright. "
        "Mount it flat or on edge, and type the same line again."
    ),
    "calibrate.lifted-over-corner": (
        "it was lifted over a corner: gravity moved by {first_m_s2:.1f} m/s² along one axis of the chip "
        "and by {second_m_s2:.1f} along another, expected less than {clear:.2f} of it. Lift the front "
        "straight over the rear; at 45° none of the chip's axes points ahead: turn it on the vehicle."
    ),
    "calibrate.motor-does-not-turn": (
        "motor {side:word}, {direction:word}: the vehicle did not turn even at full duty. Is the battery on, are the "
        "motor's two wires and its enable pin (D9 left, D10 right) plugged in?"
    ),
    "calibrate.no-push": (
        "with both motors on the IMU felt a push of {push_m_s:.2f} m/s in {push_s:g} s, too little to tell ahead "
        "from back. Is the way free, and does [robot] imu_axes name the axis that points ahead? Type: {fix}"
    ),
    "calibrate.few-duties": (
        "{name}: of {duties} duties from {low:.0%} to {high:.0%} only {moved} moved the wheel, expected 4 or "
        "more. Does it slip, is the battery low?"
    ),
    "calibrate.dead-zone": (
        "{name}: the wheel stands still below a duty of {dead_zone:.0%}, and the firmware makes up for 70 % at "
        "most. Charge the battery, or look for what brakes the wheel."
    ),
    "hardware.service-has-it": (
        "the service has the hardware, and may not be stopped by this user ({error}). Type: {fix}"
    ),
    "hardware.drives": (
        "the vehicle drives ({state}), and what you typed takes the hardware away from it. Wait until it is "
        "done, or end it: baqueano robot stop"
    ),
    "floor.not-still": (
        "the vehicle does not stand still with its motors off: the gyro scatters by {scatter_deg_s:.1f} °/s. Put "
        "it on a level floor and leave it alone."
    ),
    "floor.gravity": (
        "the IMU feels ({x:.1f}, {y:.1f}, {z:.1f}) m/s² ahead, left and up, expected (0, 0, 9.8): the vehicle "
        "lies on its side, or [robot] imu_axes is wrong. Type: {fix}"
    ),
}
