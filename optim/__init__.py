"""Design by gradient: variables of scenes, what is wanted of their solutions, and the search for it.

>>> import optim
>>> run = optim.load_run("runs/shell_grasp-001")
"""

from .objectives import Goal as Goal
from .objectives import Limits as Limits
from .objectives import Problem as Problem
from .objectives import Quantity as Quantity
from .pareto import Front as Front
from .pareto import pareto as pareto
from .run import load_run as load_run
from .search import SearchResult as SearchResult
from .search import search as search
from .variables import Space as Space
from .variables import Variable as Variable
