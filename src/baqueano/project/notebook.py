"""Write the notebook of a new project in nbformat 4.5, as the Jupyter developers define it."""

import json
from itertools import count

from baqueano.messages.language import mark as N_, translate as _

CELLS = (  # a text begins with #
    N_("""# {name}: from a drive to a controller of your own
Everything here happens in a simulation. Run the cells one by one, with Shift and Enter; then change them.

The file `vehicle.toml` contains guesses. The simulation drives the vehicle that the file names under
`[simulation]`. The fit must find the parameters of that vehicle."""),
    N_("""import baqueano as bq

robot = bq.load("vehicle.toml")  # our present model of the vehicle
robot"""),
    N_("""## 1. Drive the vehicle, and identify it
Random commands excite all of its dynamics. The fit gives each parameter with its error bar, and a verdict."""),
    """u = bq.excitation("random_steps", robot.command.limit, 30.0, robot.rate_hz)
run = bq.experiment(robot, u)
fit = bq.identify(run, robot)
fit""",
    """fit.plot("data")""",
    N_("""## 2. Noise and gains
`robot.save()` would write all of it into vehicle.toml, with its origin."""),
    N_("""path = bq.guides.shapes.sinuous_circle(0.6, 0.08, 5, 0.2)  # radius, amplitude [m], waves, speed [m/s]
robot = bq.measure_noise(fit, run).updated_file(fit.vehicle_file)
tuned = bq.tune(robot, path, starts=2)
robot = tuned.updated_file()
tuned"""),
    N_("""## 3. Teach a path, and repeat it"""),
    """route = bq.teach(robot, path, closed=True).route
lap = bq.repeat(robot, route)
lap.plot()""",
    N_("""## 4. A controller of your own
A block is a class with `init()` and a pure `step(...)`. This one turns towards the path and back onto it. The run keeps
its text."""),
    """from dataclasses import dataclass

import numpy as np

from baqueano.geometry import pose_error
from baqueano.signals import Command


@dataclass(frozen=True, eq=False)
class MyController:
    k_x: float = 3.0
    k_y: float = 40.0
    k_psi: float = 8.0

    def init(self):
        return None

    def step(self, state, reference, estimate):
        e = pose_error(reference.eta, estimate.eta)
        v, w = reference.nu[0], reference.nu[2]
        u_x = v * np.cos(e[2]) / 0.5 + self.k_x * e[0]
        u_psi = (w + v * (self.k_y * e[1] + self.k_psi * np.sin(e[2]))) / 8.0
        return state, Command(estimate.t_ns, np.clip(np.array([u_x, 0.0, u_psi]), -1.0, 1.0))


bq.check(MyController, robot)""",
    N_("""my_lap = bq.repeat(robot, route, controller=MyController(k_y=20.0))
comparison = bq.compare([lap, my_lap], names=["controller of the file", "my controller"])
comparison"""),
    """comparison.plot()""",
    N_("""## 5. Another estimator on the same data, and a figure for a paper"""),
    N_("""replayed_lap = bq.replay(lap, estimator="dead_reckoning")
bq.compare([lap, replayed_lap], names=["estimator of the file", "dead reckoning"])"""),
    N_("""my_lap.plot("errors", width="column").savefig("errors.pdf")
my_lap  # my_lap.to_pandas() is a data frame; it needs: pip install pandas"""),
)


def notebook(name: str) -> str:
    """Return the text (JSON) of the notebook of the project `name`, in the current language."""
    cell_numbers = count(1)
    cells = []
    for text in CELLS:
        source = _(text).replace("{name}", name)
        cell = {
            "id": f"cell-{next(cell_numbers)}",
            "metadata": {},
            "source": source.splitlines(keepends=True),
        }
        if text.startswith("#"):
            cells.append({"cell_type": "markdown"} | cell)
        else:
            cells.append({"cell_type": "code", "execution_count": None, "outputs": []} | cell)
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    document = {"cells": cells, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(document, ensure_ascii=False, indent=1) + "\n"
