"""Model predictive control: the block (mpc.py), its model over the horizon (horizon.py), the solver (program.py)."""

from baqueano.controllers.mpc.mpc import Mpc
