"""The page: a process of its own between browsers and the service of a vehicle, or a recorded run.

    browser ──WebSocket──► page process ──words of door/──► service of a robot, or of a simulation
                                └────── pipes ────────────► lab worker: what needs numpy (lab/)

It cannot hurt the loop, imports no numpy, and never makes a sign of life of its own.

server, http, guard     who may connect, and to what
visitor                 one browser: its words, and what waits for it
page, live              what the words of a browser do: with runs, with a vehicle
feed, lease, sentence   ticks on their way to all browsers; who drives; the state in words
service                 the vehicle
run, share              the process, and the address that it prints
static/                 what the browser gets
"""

PROTOCOL = 1
SUBPROTOCOL = f"baqueano.{PROTOCOL}"
