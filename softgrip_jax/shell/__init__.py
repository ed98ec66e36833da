"""The flat shell actuator and its scenes."""

from ..names import listing as _listing
from . import obstacles as obstacles
from .cylinder import AxialOffset as AxialOffset
from .cylinder import CylinderContact as CylinderContact
from .flat import FlatContact as FlatContact
from .flat import InclinedContact as InclinedContact
from .flat_shell import FlatShell as FlatShell
from .free import Free as Free
from .free import Plate as Plate
from .grasp import Grasp as Grasp
from .grasp import smallest_object as smallest_object
from .grasp import tilt_moment as tilt_moment
from .obstacle_contact import ObstacleContact as ObstacleContact

__dir__ = _listing(globals(), "obstacles")
