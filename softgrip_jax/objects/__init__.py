"""What is grasped, and the friction that holds it."""

from ..names import listing as _listing
from .friction import Friction as Friction
from .friction import FrictionLaw as FrictionLaw
from .friction import FrictionTable as FrictionTable
from .friction import OnSlope as OnSlope
from .friction import friction as friction
from .friction import friction_coefficient as friction_coefficient
from .friction import friction_force as friction_force
from .friction import required_normal_force as required_normal_force
from .friction import to_friction as to_friction
from .grasped import Cone as Cone
from .grasped import Cylinder as Cylinder
from .grasped import HexagonalCylinder as HexagonalCylinder
from .grasped import Object as Object
from .grasped import Taper as Taper
from .grasped import ThreeFaceCone as ThreeFaceCone

__dir__ = _listing(globals())
