"""Prepare routes before they are driven: from points, a run or a shape, in a few lines.

    route = routes.smooth(route, 0.02)                        # 2 cm rms from the taught route
    route = routes.fastest(route, robot)                      # as fast as this vehicle can
    print(routes.examine(route, robot, "2x3"))                # the demands of the route on vehicle and room

The functions do not change a route but return a new one. The type is `guides.Route`.
"""

from baqueano.on_demand import unknown_names
from baqueano.routes.edit import cut, join, reverse, scale
from baqueano.routes.examine import RouteReport, examine
from baqueano.routes.points import through_points
from baqueano.routes.profile import at_speed, fastest
from baqueano.routes.smoothing import smooth

__all__ = [
    "RouteReport",
    "at_speed",
    "cut",
    "examine",
    "fastest",
    "join",
    "reverse",
    "scale",
    "smooth",
    "through_points",
]

__getattr__ = unknown_names(__name__)
