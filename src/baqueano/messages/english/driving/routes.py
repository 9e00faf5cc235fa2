"""English sentences about routes that are prepared and examined."""

TEMPLATES: dict[str, str] = {
    "route.no-way": (
        "The route is {length_m:.3f} m long: expected at least four points, a millimetre apart. Teach it "
        "with a drive in which the vehicle moves."
    ),
    "route.both-ways": (
        "the route changes between forward and backward {count} times, first at {position_m:.2f} m. Cut it there, "
        "and work on each part: {fix}"
    ),
    "route.tolerance": "tolerance {value:g} m: expected {min_m:g} to {largest_m:g} m.",
    "route.cut": (
        "The part from {start_m:g} to {end_m:g} m does not lie on the route: expected 0 ≤ from < to ≤ {length_m:.2f} m."
    ),
    "route.join-reverses": (
        "The first route ends at {first_m_s:.2f} m/s, the second begins at {second_m_s:.2f} m/s. One is "
        "driven forward, the other backward. Reverse one of them: {fix}"
    ),
    "route.factor": "factor {value:g}: expected a positive number; 2 makes a route twice as large.",
    "route.speed": "speed {value:g} m/s: expected a positive number.",
    "route.limit": "{name} = {value:g}: expected a positive number; a fraction is at most 1.",
    "route.absent": (
        "Route {value} does not exist: {absent_path} is not a file. {valid}. To drive it once: {fix}"
    ),
    "route.absent-stored": "Route {value} does not exist: {absent_path} is not a file. {suggestion}.",
    "route.absent-shape": (
        "Route {value} does not exist: {absent_path} is not a file. Did you mean the shape {shape}? Type: {fix}"
    ),
    "route.none-stored": "That folder does not contain routes yet",
    "route.points": "points have the shape {value}: expected at least two rows of x and y in metres, (m, 2).",
    "route.point-not-finite": (
        "Point {number} contains a value that is not a number. Give x and y in metres, or remove the point."
    ),
    "route.points-far": (
        "Points {first} and {second} are {distance_m:.1f} m apart: expected at most 20 m. Are the columns in metres, "
        "and is a point missing between them?"
    ),
    "route.too-tight": (
        "The curve at {position_m:.2f} m has a radius of {radius_m:.3f} m: even slowly, the vehicle needs more than "
        "{command_share:.0%} of its command there. Make the route smoother or larger, or allow a larger share: {fix}"
    ),
    "route.jump": (
        "the route jumps by {gap_m:.2f} m at {position_m:.2f} m ({t_s:.1f} s), {count} times in all: "
        "the path in the gap is unknown. Cut it there, or teach it again: {fix}"
    ),
    "route.open-ends": (
        "the route is closed, but its end is {gap_m:.2f} m from its start, and the path between them is unknown. "
        "Teach it again, or make an open route of it: {fix}"
    ),
    "route.sudden-turn": (
        "the heading of the route turns by {turn_deg:.0f}° at once at {position_m:.2f} m ({t_s:.1f} s), {count} "
        "times in all. Cut it there, or teach it again: {fix}"
    ),
    "route.gap": (
        "samples are missing at {position_m:.2f} m ({t_s:.1f} s): the next pose is {gap_m:.2f} m and {gap_s:.1f} s "
        "further, and the path between is not known. There are {count} such places. Cut it there, or teach it "
        "again: {fix}"
    ),
    "route.no-number": (
        "{count} rows of the route contain something that is not a number; the first is row {row}. Correct "
        "the file, or teach the route again: {fix}"
    ),
    "route.time-order": (
        "the time in row {row} of the route does not increase. Correct the rows, or compute the times from a speed: "
        "{fix}"
    ),
    "route.speed-too-high": (
        "at {position_m:.1f} m the route needs {demand_m_s:.2f} m/s, but the vehicle reaches "
        "{max_m_s:.2f}. Compute speeds that the vehicle reaches: {fix}"
    ),
    "route.turns-too-fast": (
        "at {position_m:.1f} m and {speed_m_s:.2f} m/s the route needs {demand_rad_s:.1f} "
        "rad/s, but the vehicle reaches {max_rad_s:.1f}. Compute speeds that the vehicle "
        "reaches: {fix}"
    ),
    "route.noisy": (
        "the positions of the route have a noise of {noise_mm:.0f} mm, and the vehicle would follow it. Smooth the "
        "route: {fix}"
    ),
    "route.curve-too-tight": (
        "at {position_m:.1f} m the route has a radius of {radius_m:.2f} m, but even slowly the vehicle needs "
        "{min_radius_m:.2f} m. Make it larger or smoother: {fix}"
    ),
    "route.sideways": (
        "at {position_m:.1f} m the route moves sideways with {speed_m_s:.2f} m/s, but no command moves the vehicle "
        "sideways. Take the headings from the path: {fix}"
    ),
    "route.otherwise": (
        "at {position_m:.1f} m the poses of the route move forward with {speed_m_s:.2f} m/s, but its velocity is "
        "{velocity_m_s:.2f} m/s. Compute the velocities from the poses: {fix}"
    ),
    "route.accelerates-too-fast": (
        "at {position_m:.1f} m the route needs {share:.0%} of the command, to speed up or to enter a "
        "curve. Compute speeds that the vehicle reaches: {fix}"
    ),
    "route.through-wall": (
        "the route leaves the room: at {position_m:.1f} m the body is {excess_m:.2f} m beyond the wall. Make it "
        "smaller, or give a larger room or another start: {fix}"
    ),
    "route.columns-unused": (
        "The columns {names} are not used: the route passes the points at {speed_m_s:g} m/s. To drive the poses and "
        "speeds of a route file, copy it into the folder {folder}."
    ),
    "route.columns": (
        "{path} has the columns {value}: expected x and y in metres, as x_m and y_m, or x and y. Rename them in its "
        "first line."
    ),
}
