"""The pneu-net finger: chambers, cover, and the scenes of a finger and of a gripper of n fingers."""

from ..names import listing as _listing
from .beam.method import Collocation as Collocation
from .beam.method import Shooting as Shooting
from .cell import Cell as Cell
from .finger import PneuNet as PneuNet
from .finger_scene import shooting_error as shooting_error
from .free import Free as Free
from .grasp import Grasp as Grasp
from .grasp import Gripper as Gripper
from .grasp import largest_mass as largest_mass
from .linear import Linear as Linear
from .section.base import SectionLaw as SectionLaw
from .tip_contact import TipContact as TipContact
from .wall.arc import Chamber as Chamber
from .wall.base import WallModel as WallModel
from .wall.pressures import chamber as chamber
from .wall.pressures import contact_pressure as contact_pressure
from .wall.pressures import wall_limit as wall_limit
from .wall.small_strain import SmallStrainChamber as SmallStrainChamber
from .wall.small_strain import SmallStrainWalls as SmallStrainWalls

__dir__ = _listing(globals())
