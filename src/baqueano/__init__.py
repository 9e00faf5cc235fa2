"""baqueano: identify, estimate, control and guide a small autonomous vehicle from its commands and IMU.

    import baqueano as bq

    robot = bq.load("small")                    # a vehicle file: your own, or one of the package
    run = bq.experiment(robot, bq.excitation("random_steps", robot.command.limit, 60.0, robot.rate_hz))
    fit = bq.identify(run, robot)
    fit.plot()

The functions have the names of the commands of the command line; each is imported at its first use. The six packages of
blocks are `vehicles`, `sensors`, `estimators`, `guides`, `controllers` and `worlds`; `routes` prepares routes.
"""

from baqueano.on_demand import front_door, register

TYPE_CHECKING = False
if TYPE_CHECKING:
    from baqueano import controllers, estimators, guides, routes, sensors, vehicles, worlds
    from baqueano.compare import compare
    from baqueano.compare.corridor_forecast import forecast_corridor as forecast
    from baqueano.drive import experiment, repeat, replay, teach
    from baqueano.identify import FitOptions, excitation, identify, measure_noise
    from baqueano.project import new
    from baqueano.report import report
    from baqueano.runs import import_run, read_run
    from baqueano.simulate import simulate
    from baqueano.sweep import sweep
    from baqueano.tune import tune
    from baqueano.vehicle_file import load
    from baqueano.vehicle_file.block_check import check

__version__ = "0.1.0"

__all__ = [
    "FitOptions",
    "check",
    "compare",
    "controllers",
    "estimators",
    "excitation",
    "experiment",
    "forecast",
    "guides",
    "identify",
    "import_run",
    "load",
    "measure_noise",
    "new",
    "read_run",
    "repeat",
    "replay",
    "report",
    "routes",
    "sensors",
    "simulate",
    "sweep",
    "teach",
    "tune",
    "vehicles",
    "worlds",
]

__getattr__ = front_door(
    __name__,
    {
        "compare": ("compare",),
        "compare.corridor_forecast": ("forecast_corridor as forecast",),
        "drive": ("experiment", "repeat", "replay", "teach"),
        "identify": ("FitOptions", "excitation", "identify", "measure_noise"),
        "project": ("new",),
        "report": ("report",),
        "runs": ("import_run", "read_run"),
        "simulate": ("simulate",),
        "sweep": ("sweep",),
        "tune": ("tune",),
        "vehicle_file": ("load",),
        "vehicle_file.block_check": ("check",),
    },
    ("controllers", "estimators", "guides", "routes", "sensors", "vehicles", "worlds"),
)

register("baqueano.signals", "Command", "Estimate", "Reference", "Tick")
register(
    "baqueano.guides.shapes", "circle", "clothoid", "eight", "line", "rectangle", "sinuous_circle", "slalom"
)
# called by packages below: a result is drawn by `report`, and `compare` gives fits to `validation`
register("baqueano.report.card", "card_html")
register("baqueano.report.plots", "plot")
register("baqueano.report.tables", "save_result")
register("baqueano.validation.parameter_drift", "compare_fits")


def __dir__() -> list[str]:
    """Return the public names, for the completion of `bq.`."""
    return [*__all__, "__version__"]
