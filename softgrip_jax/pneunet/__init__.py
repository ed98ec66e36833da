"""The pneu-net finger: chambers, cover, and the scenes of a finger and of a gripper of n fingers."""

from ..names import listing as _listing
from .beam_method import Collocation as Collocation
from .beam_method import Shooting as Shooting
from .cell import Cell as Cell
from .chamber import Chamber as Chamber
from .chamber import SmallStrainChamber as SmallStrainChamber
from .chamber import chamber as chamber
from .chamber import contact_pressure as contact_pressure
from .chamber import wall_limit as wall_limit
from .finger import PneuNet as PneuNet
from .finger_scene import shooting_error as shooting_error
from .grasp import Grasp as Grasp
from .grasp import Gripper as Gripper
from .grasp import largest_mass as largest_mass
from .linear import Linear as Linear
from .scenes import Free as Free
from .scenes import TipContact as TipContact

__dir__ = _listing(globals())
