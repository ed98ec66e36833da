"""Solutions as pictures. The only room that imports matplotlib; every function returns what it drew on.

Lengths in mm, pressures in kPa.
"""

from typing import TYPE_CHECKING

import lazy_loader

from ..names import listing as _listing
from . import chamber as chamber
from . import energy as energy
from . import finger as finger
from . import shell as shell
from .animation import animate as animate
from .curves import Curve as Curve
from .curves import Diagram as Diagram
from .curves import curve_of as curve_of
from .curves import diagrams as diagrams
from .figures import compare as compare
from .figures import convergence as convergence
from .figures import draw as draw
from .figures import has_picture as has_picture
from .figures import paints as paints
from .figures import pressure_curve as pressure_curve
from .fits import Line as Line
from .fits import Panel as Panel
from .fits import Points as Points
from .fits import measured_and_fitted as measured_and_fitted
from .posterior import Band as Band
from .posterior import corner as corner
from .posterior import predictive as predictive
from .robust import Cast as Cast
from .robust import robust as robust

if TYPE_CHECKING:
    from .studies import elasticities as elasticities
    from .studies import front as front
    from .studies import study as study

# xarray, and pandas with it, take as long to load as matplotlib: only a picture of many designs waits for them.
__getattr__, _, _lazy = lazy_loader.attach(__name__, submod_attrs={"studies": ["elasticities", "front", "study"]})
__dir__ = _listing(globals(), *_lazy)
