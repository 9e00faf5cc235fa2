"""Patterns of the names of columns, in English, Spanish and ROS, for the draft of a map.

They are searched in `plain_name` of a column: lower case, words separated by _.
"""

TIME_PATTERN = r"(^|_)(t|time|tiempo|timestamp|stamp|elapsed|millis|micros|fecha|hora)(_|$)"
LEFT_PATTERN = r"(^|_)(left|izq(uierd[ao])?|l|port|babor)(_|$)"
RIGHT_PATTERN = r"(^|_)(right|der(ech[ao])?|r|stbd|starboard|estribor)(_|$)"
COMMAND_PATTERN, SPEED_PATTERN = (
    r"pwm|duty|ciclo|cmd|command|comando|throttle|acelerador|traccion|potencia|steer|servo|volante|direccion|^u_"
    r"|thrust|empuje|(^|_)(thr|esc|propeller|helice)(_|$)",
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
    r"(^|_)(yaw|psi|theta|heading|rumbo|guinada|orientacion)(_|$)",
)
BATTERY_PATTERN = r"(^|_)(v?bat(t|tery|eria)?)(_|$)|^(volts?|voltage|tension)(_|$)"
COMPASS_PATTERN = r"(^|_)(compass|brujula)(_|$)"
