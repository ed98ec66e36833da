"""Parameter studies: sets of designs, their quantities in chunks, and labelled results.

>>> study = sg.Study(scene, ["shell.a", "shell.t_m"], [sg.Quantity("force", at=15e3)], Sobol(ranges, 4096))
>>> data = study.run()                     # an xarray Dataset
>>> data = sg.load_study("runs/sweep-001")    # the result of `softgrip sweep`
"""

from ..names import listing as _listing
from .dataset import labelled as labelled
from .designs import Designs as Designs
from .designs import Grid as Grid
from .designs import LatinHypercube as LatinHypercube
from .designs import Range as Range
from .designs import Sobol as Sobol
from .designs import Table as Table
from .sensitivity import sensitivity as sensitivity
from .store import load_study as load_study
from .store import run_in as run_in
from .study import Study as Study

__dir__ = _listing(globals())
