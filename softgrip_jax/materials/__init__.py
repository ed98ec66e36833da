"""Strain energies of incompressible hyperelastic materials: what one says of itself, the laws, and measured silicones.

A material of one's own derives from `Material` and needs its `energy` and nothing else.
"""

from ..names import listing as _listing
from .base import ClosedForms as ClosedForms
from .base import Material as Material
from .base import modulus_of_energy as modulus_of_energy
from .base import nominal_stresses as nominal_stresses
from .laws import Gent as Gent
from .laws import InvariantMaterial as InvariantMaterial
from .laws import MooneyRivlin as MooneyRivlin
from .laws import NeoHookean as NeoHookean
from .laws import Ogden as Ogden
from .laws import Yeoh as Yeoh
from .presets import PRESETS as PRESETS
from .presets import dragon_skin_20 as dragon_skin_20
from .presets import dragon_skin_20_shell as dragon_skin_20_shell
from .presets import dragon_skin_30 as dragon_skin_30

__dir__ = _listing(globals(), "PRESETS")
