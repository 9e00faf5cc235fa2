"""Read, check and write vehicle.toml. `load("small")` reads a file of the garage, `load("my.toml")` your file.

Reading needs only the standard library; writing (`with_values`) needs tomlkit, which keeps comments.
"""

from typing import TYPE_CHECKING

from baqueano.on_demand import on_demand
from baqueano.vehicle_file.file import CommandSpec, VehicleFile, load, parse
from baqueano.vehicle_file.garage import names as garage_names
from baqueano.vehicle_file.provenance import ParameterCov, Provenance

if TYPE_CHECKING:
    from baqueano.vehicle_file.text.override import override

__all__ = ["CommandSpec", "VehicleFile", "garage_names", "load", "override", "parse"]

__getattr__ = on_demand(__name__, {"text.override": ("override",)})
