"""Drive manually with keys, a game pad and a display, which `Cockpit` combines into one source of commands.

keys, pad        the input of a terminal or a game pad, as events
tty, evdev       the devices that send these events
key_hold         events → direction and speed
terminal_heartbeat   test if the terminal is still connected
screen, dead_zone    the display for the driver
heading_gains        gains of the heading hold, from the vehicle file
"""
