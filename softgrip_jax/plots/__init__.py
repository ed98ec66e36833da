"""Solutions as pictures. The only room that imports matplotlib; every function returns what it drew on.

Lengths in mm, pressures in kPa.
"""

from . import finger as finger
from . import shell as shell
from .figures import compare as compare
from .figures import convergence as convergence
from .figures import draw as draw
from .figures import has_picture as has_picture
from .figures import paints as paints
from .figures import pressure_curve as pressure_curve
