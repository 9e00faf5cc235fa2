"""A person who drives: keys, a game pad and a screen, as one hand; `Cockpit` puts them together.

keys, pad        what a terminal or a game pad sends, as events
tty, evdev       the devices they come from
key_hold         events → direction and speed
terminal_heartbeat   whether the terminal is still there
screen, dead_zone    what the person is shown
heading_gains        gains of the heading hold, by the vehicle file
"""
