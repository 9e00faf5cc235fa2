"""Serve the page: a separate process between browsers and the service of a vehicle, or a recorded run.

    browser ──WebSocket──► page process ──messages of door/──► service of a robot, or of a simulation
                                └────── pipes ───────────────► worker process: all that needs numpy (lab/)

The page process cannot disturb the control loop, does not import numpy, and only forwards heartbeats of browsers.

server, http, guard     decide which browsers are allowed to connect, and with which rights
visitor                 one browser: its messages, and the queues of messages and pictures for it
page, live              carry out the messages of a browser: about runs, about a vehicle
feed, lease, sentence   the ticks for all browsers; the right to drive; the state as sentences
service                 the connection to the vehicle
run, share              the process from start to end, and the address that it prints
static/                 the files that the browser loads
"""

PROTOCOL = 3
SUBPROTOCOL = f"baqueano.{PROTOCOL}"
