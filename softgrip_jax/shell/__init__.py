"""The flat shell actuator and its scenes."""

from ..names import listing as _listing
from . import obstacles as obstacles
from .arc.cylinder import AxialOffset as AxialOffset
from .arc.cylinder import CylinderContact as CylinderContact
from .arc.flat import FlatContact as FlatContact
from .arc.free import Free as Free
from .arc.free import Plate as Plate
from .arc.grasp import Grasp as Grasp
from .arc.grasp import smallest_object as smallest_object
from .arc.grasp import tilt_moment as tilt_moment
from .arc.inclined import InclinedContact as InclinedContact
from .energy.obstacle_contact import ObstacleContact as ObstacleContact
from .flat_shell import FlatShell as FlatShell

__dir__ = _listing(globals(), "obstacles")
