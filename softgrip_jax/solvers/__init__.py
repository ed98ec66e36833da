"""How an equilibrium is found, as a choice: `sg.solve(scene, pressure, solver=...)`.

Every kind of scene has a solver of its own, which is sure to stay on the branch connected to zero load and is what
`solve` uses by itself: `ExplicitCurve` (one unknown), `ArcLength` (several), `MinimumEnergy` (the energy membrane).
`Newton` begins from a guess instead, and its answer is certified before it counts.

A solver finds values. Their derivatives are attached by the implicit function theorem, whatever found them, and the
residual is judged in the same way: what is not solved to rounding is NOT_CONVERGED.
"""

from ..names import listing as _listing
from ..scene import Solver as Solver
from .arc_length import ArcLength as ArcLength
from .explicit_curve import ExplicitCurve as ExplicitCurve
from .minimum_energy import MinimumEnergy as MinimumEnergy
from .newton import Newton as Newton

__dir__ = _listing(globals(), "Solver")
