"""Find columns by their names in English, Spanish and ROS, for the draft of a map.

The patterns are searched in `plain_name` of a column: lower case, words separated by _.
"""

import re
import unicodedata
from collections.abc import Sequence
from functools import lru_cache

# letters that a name keeps
SIGNS = str.maketrans({"°": "deg", "º": "deg", "µ": "u", "μ": "u", "%": "percent", "^": ""})
TIME_PATTERN = r"(^|_)(t|time|tiempo|timestamp|stamp|elapsed|millis|micros|fecha|hora)(_|$)"
LEFT_PATTERN = r"(^|_)(left|izq(uierd[ao])?|l|port|babor)(_|$)"
RIGHT_PATTERN = r"(^|_)(right|der(ech[ao])?|r|stbd|starboard|estribor)(_|$)"
COMMAND_PATTERN, SPEED_PATTERN = (
    r"pwm|duty|ciclo|cmd|command|comando|throttle|acelerador|traccion|potencia|steer|servo|volante|direccion|^u_"
    r"|thrust|empuje|^orden_|(^|_)(thr|esc|propeller|helice)(_|$)",
    r"rpm|speed|vel|encoder|wheel|rps|^v_",
)
SPEED_ENDING = r"_([cm]?m_s|mps|km_?h)$"  # left_m_s: the unit alone states that it is a speed
# commands of a left and a right wheel; a single voltage is that of the battery
SETPOINT_PATTERN = r"(^|_)(volts?|voltage|set(point)?|target|goal|ref(erence)?|consigna|tension)(_|$)"
VOLTAGE_PATTERN = r"(^|_)(volts?|voltage|tension)(_|$)"
PIN_PATTERN = r"(^|_)(dir(ec(tion|cion))?|sentido|sign)(_|$)"  # of the direction of a motor: 0 and 1
STEERING_PATTERN = r"steer|servo|volante|direccion"
BARE_SIDES = tuple(  # two columns that are named only by their side
    rf"^((motor|rueda|wheel|u)?_?({side})|(motor|rueda|wheel|u)_?{letter})(_(percent|pct|m?v))?$"
    for side, letter in (
        ("left|izq(uierd[ao])?|port|babor", "l"),
        ("right|der(ech[ao])?|stbd|starboard|estribor", "r"),
    )
)
FORWARD_PATTERN = r"^(?!.*(ang|acc|gyr|gir|omega|imu)).*(^|_)((speed|vel(ocity|ocidad)?(_x)?)(_|$)|linear_x$)"
ENCODER_NAMES = r"enc|encoder|hall|pulses?|pulsos?"
ENCODER_PATTERN = rf"(^|_)({ENCODER_NAMES})(_|$)"
COUNT_PATTERN = rf"{ENCODER_PATTERN}|(^|_)(counts?|cnt|ticks?)(_|$)"
TWIST_PATTERNS = r"(^|_)linear_x$", r"(^|_)angular_z$"  # names of ROS
ROS_PATTERN = r"(^|_)(linear|angular)(_acceleration|_velocity)?_[xyz]$"  # in SI by REP 103
ROS_UNITS = {"speed": "m/s", "angular rate": "rad/s", "acceleration": "m/s^2"}
SETPOINT_WORDS = "cmd|command|comando|set(point)?|sp|target|goal|ref(erence)?|desired|consigna"
# cmd_vel/linear/x, v_set, target_omega; the unit at the end of "cmd_left [V]" is not a speed
TWIST_COMMANDS = tuple(
    rf"(?=.*cmd).*{ros_name}|(^|_)(({SETPOINT_WORDS})_({name})|({name})_({SETPOINT_WORDS}))(_|$)"
    for ros_name, name in (
        (TWIST_PATTERNS[0], "vx?|speed|velocidad"),
        (TWIST_PATTERNS[1], "w|wz|omega|yaw_?rate|turn_?rate|giro"),
        (r"(^|_)linear_y$", "vy"),
    )
)
EAST_NORTH_PATTERNS = tuple(
    rf"^(.*_)?({direction})(_[cm]?m)?$" for direction in ("e|east(ing)?|este", "n|north(ing)?|norte")
)
GEOGRAPHIC_PATTERNS = r"(^|_)(lon|lng|long)(gitude|gitud)?(_|$)", r"(^|_)lat(itude|itud)?(_|$)"
QUATERNION_PATTERNS = tuple(
    rf"^(?!.*(odom|imu)).*(^|_)(orientation|rotation|quat(ernion)?|q)_?{axis}(_|$)" for axis in "xyzw"
)
POSITION_PATTERN = r"^(?!.*(odom|linear|angular|acc|acel|gyr|gir|mag|omega|vel)).*(^|_)"
POSE_PATTERNS = (
    rf"{POSITION_PATTERN}x(_|$)",
    rf"{POSITION_PATTERN}y(_|$)",
    r"(^|_)(yaw|psi|theta|heading|hdg|rumbo|guinada|orientacion)(_|$)",
)
BATTERY_PATTERN = r"(^|_)(v?bat(t|tery|eria)?)(_|$)|^(volts?|voltage|tension)(_|$)"
COMPASS_PATTERN = r"(^|_)(compass|brujula)(_|$)"


@lru_cache(1_000)
def plain_name(name: str) -> str:
    """Return a column's name in lower case and without accents, with its words separated by _. A capital after two
    small letters begins a word: `cntL`. After one it can end a unit: `mV`.
    """
    words = unicodedata.normalize("NFKD", name.translate(SIGNS))
    letters = "".join(c for c in words if not unicodedata.combining(c))
    letters = re.sub(r"(?<=[a-z]{2})(?=[A-Z])", "_", letters)
    return re.sub(r"[^a-z0-9]+", "_", letters.lower()).strip("_")


def take_column(free_columns: list[str], pattern: str) -> str:
    """Return the first column whose name matches, and remove it from `free_columns`. Return "" if none matches."""
    column = next((name for name in free_columns if re.search(pattern, plain_name(name))), "")
    if column:
        free_columns.remove(column)
    return column


def take_all(free_columns: list[str], patterns: Sequence[str]) -> list[str]:
    """Return one column for each pattern, and remove them from `free_columns`. Return [] if one is missing."""
    remaining_columns = list(free_columns)
    columns = [take_column(remaining_columns, pattern) for pattern in patterns]
    if not all(columns):
        return []
    free_columns[:] = remaining_columns
    return columns


def take_pair(free_columns: list[str], pattern: str) -> list[str]:
    """Return the columns of the left and right wheel whose names match, and remove them from `free_columns`.
    Return [] if one of them is missing."""
    return take_all(free_columns, [f"(?=.*({pattern})).*{side}" for side in (LEFT_PATTERN, RIGHT_PATTERN)])
