"""Equilibrium paths residual(y, load) = 0 by arc length: goals, limit points, and the curve through them.

A path is followed from a known point in the direction of growing load, so what is found is on the branch connected to
that point and on no other. Points are vectors u = (y, load), scaled by the caller so that each entry is of order one.
No derivatives pass through a search (see `implicit`).

One loop does everything (steps, the search for a limit point, the last step to the goal), one Newton iteration of
whatever is under way at a time: the residual and its Jacobian are compiled once, which is what users wait for, and
members of a batch do not wait for each other's iterations (see `batching.in_blocks`).

Libraries that were looked at: optimistix and diffrax follow no paths. JaxCont does, in JAX and under vmap, but a
step counts there as soon as Newton's method has converged, so it may leap to another branch; it ends at a value of the
parameter and not at a goal, solves with a Newton loop inside the loop of the steps, and keeps a buffer of every point.
FContin wraps pacopy, and PyCont-Lite is NumPy: neither can be compiled or batched. AUTO-07p, MatCont and
BifurcationKit are programs in other languages.

    newton.py      one Newton step, and when to stop
    points.py      a point with its tangent, and whether a new one is the path's next
    search.py      the state of a search, and what comes after each Newton iteration
    loop.py        the loop
    limit_load.py  the load of a limit point, with derivatives
    curve.py       the curve at equal arc lengths
"""

from .curve import trace as trace
from .limit_load import fold_load as fold_load
from .loop import MAX_STEPS as MAX_STEPS
from .loop import Climb as Climb
from .loop import End as End
from .loop import Steps as Steps
from .loop import follow as follow
from .points import DETOUR as DETOUR
from .points import TURN as TURN
from .search import BIFURCATION as BIFURCATION
from .search import ENDED as ENDED
from .search import FIRST_STEP as FIRST_STEP
from .search import FOLD as FOLD
from .search import LARGEST_STEP as LARGEST_STEP
from .search import REACHED as REACHED
