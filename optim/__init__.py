"""Design by gradient: variables of scenes, what is wanted of their solutions, and the search for it; and calibration.

>>> import optim
>>> run = optim.load_run("runs/shell_grasp-001")
"""

from softgrip_jax.names import listing as _listing

from .calibrate import Fit as Fit
from .calibrate import calibrate as calibrate
from .curve_files import Curve as Curve
from .fitting import Fitting as Fitting
from .intervals import intervals as intervals
from .objectives import Goal as Goal
from .objectives import Limits as Limits
from .objectives import Problem as Problem
from .objectives import Quantity as Quantity
from .pareto import Front as Front
from .pareto import pareto as pareto
from .run import load_run as load_run
from .search import SearchResult as SearchResult
from .search import search as search
from .tension import Tension as Tension
from .variables import Space as Space
from .variables import Variable as Variable

__dir__ = _listing(globals(), "Quantity")
