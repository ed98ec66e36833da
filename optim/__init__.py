"""Design by gradient: variables of scenes, what is wanted of their solutions, and the search for it; and calibration.

>>> import optim
>>> run = optim.load_run("runs/shell_grasp-001")
"""

from softgrip_jax.names import listing as _listing

from .calibration.data import Curve as Curve
from .calibration.fit import Fit as Fit
from .calibration.fit import calibrate as calibrate
from .calibration.intervals import intervals as intervals
from .calibration.model import Fitting as Fitting
from .design.descent import SearchResult as SearchResult
from .design.descent import search as search
from .design.pareto import Front as Front
from .design.pareto import pareto as pareto
from .design.run import load_run as load_run
from .problem import Goal as Goal
from .problem import Limits as Limits
from .problem import Problem as Problem
from .problem import Quantity as Quantity
from .space import Space as Space
from .space import Variable as Variable
from .tension.test import Tension as Tension

__dir__ = _listing(globals(), "Quantity")
