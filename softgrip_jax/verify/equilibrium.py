"""Equilibria of a solid under a following pressure, against a rigid frictionless object: Newton, in steps of the load.

The displacement is u = T y + g: T holds what is clamped, lies in a plane of symmetry, or stays in a plane that turns.
Contact is a penalty at quadrature points of the outer face, with multipliers (augmented Lagrange) at the pressures that
are asked for, so that what is reported hardly depends on the penalty.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from .solid import Faces, Solid

ITERATIONS = 14
"""Of one step; a step that needs more is cut in two."""
PATIENCE = 40
"""Iterations from the state of a coarser mesh, whose volumes the finer one corrects first."""
OUT_OF_BALANCE = 1e-7
"""Forces out of balance, over what the air does on the faces that it presses."""
LEAST_STEP = 1 / 512
"""Of the largest pressure or curvature: where smaller steps would be needed no equilibrium is near."""
FIRST_STEP = 1 / 24
"""Of the largest pressure or curvature, for the first step."""
GROWTH = 1.7
FEW_ITERATIONS = 6
"""Iterations of a step after which the next one is GROWTH as long."""
AUGMENTED = 2
"""Rounds of new multipliers at a pressure that was asked for: each leaves some percent of the penetration."""
STRAIN = 0.5
"""Largest change of F at any point in one iteration; longer ones turn small elements at the clamp inside out."""


class Touch(NamedTuple):
    """An object at points.

    Args:
        gap: signed distances, m, negative inside, shape (n,).
        slope: their derivatives by the place, shape (n, 3).
        curvature: their second derivatives, 1/m, shape (n, 3, 3); None where they are zero.
        by_shift: derivative by the last unknown where the object moves with it, else 0.
    """

    gap: np.ndarray
    slope: np.ndarray
    curvature: np.ndarray | None
    by_shift: float = 0.0


class Contact(NamedTuple):
    """Faces that may touch an object.

    Args:
        faces: quadrature points.
        touch: (places, shape (n, 3) in m; the last unknown) -> Touch.
        stiffness: of the penalty, Pa/m.
    """

    faces: Faces
    touch: Callable[[np.ndarray, float], Touch]
    stiffness: float


@dataclasses.dataclass
class State:
    """An equilibrium, or a guess of one.

    Args:
        pressure: of the air, Pa.
        y: unknowns of the displacement.
        q: pressures of the elements, Pa, shape (elements, 4).
        multipliers: contact pressures per area at rest, Pa, shape of the contact's points.
        bend: curvature to which the constraints bend the solid, 1/m.
    """

    pressure: float
    y: np.ndarray
    q: np.ndarray
    multipliers: np.ndarray | None = None
    bend: float = 0.0


class Balance(NamedTuple):
    """What is out of balance, and what brings it back."""

    residual: np.ndarray
    reactions: np.ndarray
    """Forces on all nodes, N, of which the residual is the part along the unknowns."""
    matrix: Any
    kept: Any
    shift_force: float
    """Of the contact on the last unknown, N."""


class NoStateError(Exception):
    """Newton did not come to an equilibrium."""


def linear_solver() -> Callable[[Any, np.ndarray], np.ndarray]:
    """(symmetric sparse matrix, right side) -> solution, by PARDISO, or SciPy's SuperLU where that is not installed."""
    try:
        from pypardiso import PyPardisoSolver
    except (ImportError, OSError):
        from scipy.sparse.linalg import splu

        return lambda matrix, right: splu(matrix.tocsc()).solve(right)
    solver = PyPardisoSolver(mtype=-2)  # symmetric and indefinite

    def solve(matrix: Any, right: np.ndarray) -> np.ndarray:
        upper: Any = sp.triu(matrix, format="csr")
        upper.sort_indices()
        return solver.solve(upper, right)

    return solve


class Model:
    """A solid with its loads and constraints.

    Args:
        solid: the elements.
        pressed: faces that the air presses, if any.
        T, g: the displacement is T y + g; T has a row for each number of the displacement.
        contact: what may be touched.
        shift: whether the last unknown moves the object of the contact.
        bent: curvature (1/m) -> T, g, where the constraints bend the solid.
    """

    def __init__(
        self,
        solid: Solid,
        pressed: Faces | None,
        T: Any,
        g: Float[np.ndarray, " numbers"] | None = None,
        contact: Contact | None = None,
        shift: bool = False,
        bent: Callable[[float], tuple[Any, np.ndarray]] | None = None,
    ):
        self._bent, self._bend = bent, 0.0
        self.solid, self.pressed, self.contact, self.shift = solid, pressed, contact, shift
        self.constrain(T, g)
        self.solve = linear_solver()
        self.watch: Callable[[float], None] = lambda pressure: None

    def constrain(self, T: Any, g: np.ndarray | None = None) -> None:
        """Other constraints with the same unknowns."""
        self.T: Any = sp.csr_matrix(T)
        self.g = np.zeros(self.solid.size) if g is None else g
        self.Tt: Any = self.T.T.tocsr()

    def at(self, bend: float) -> None:
        """The constraints at a curvature, 1/m."""
        if self._bent is not None and bend != self._bend:
            self.constrain(*self._bent(bend))
            self._bend = bend

    def rest(self) -> State:
        """The solid without loads."""
        points = self.contact.faces.areas.shape if self.contact else None
        return State(
            0.0,
            np.zeros(self.T.shape[1]),
            np.zeros((len(self.solid.cells), 4)),
            np.zeros(points) if points is not None else None,
        )

    def displacement(self, y: np.ndarray) -> Float[np.ndarray, "nodes 3"]:
        """u of the unknowns, m."""
        return (self.T @ y + self.g).reshape(-1, 3)

    def touching(self, state: State) -> tuple[Touch, np.ndarray]:
        """The object at the contact's points, and the contact pressures there (Pa, per area at rest)."""
        assert self.contact is not None
        places = self.solid.at(self.contact.faces, self.displacement(state.y))
        touch = self.contact.touch(places.reshape(-1, 3), float(state.y[-1]))
        multipliers = state.multipliers if state.multipliers is not None else 0.0
        pressures = np.maximum(0.0, multipliers - self.contact.stiffness * touch.gap.reshape(places.shape[:2]))
        return touch, pressures

    def balance(self, state: State, matrix: bool = True) -> Balance:
        """What is out of balance at a state."""
        solid, u = self.solid, self.displacement(state.y)
        _, forces, blocks, kept = solid.assemble(u, state.q, matrix)
        if self.pressed is not None and state.pressure:
            push, by_u = solid.push(self.pressed, u, matrix)
            np.add.at(forces, self.pressed.elements, state.pressure * push)
            if blocks is not None and by_u is not None:
                np.add.at(blocks, self.pressed.elements, state.pressure * by_u)
        shift_force, shift_column, shift_stiffness = 0.0, None, 0.0
        if self.contact is not None:
            faces, k = self.contact.faces, self.contact.stiffness
            touch, t = self.touching(state)
            shape = t.shape
            slope = touch.slope.reshape(*shape, 3)
            weight = t * faces.areas
            phi = faces.values
            np.add.at(
                forces,
                faces.elements,
                np.einsum("fpn,fpa->fna", phi, -weight[..., None] * slope).reshape(-1, 81),
            )
            closed = np.where(t > 0, k * faces.areas, 0.0)
            if blocks is not None:
                D = closed[..., None, None] * slope[..., :, None] * slope[..., None, :]
                if touch.curvature is not None:
                    D = D - weight[..., None, None] * touch.curvature.reshape(*shape, 3, 3)
                active = np.flatnonzero(np.any(t > 0, axis=1))
                if len(active):
                    Y = np.einsum("fpac,fpm->fpamc", D[active], phi[active])
                    K = np.einsum("fpn,fpamc->fnamc", phi[active], Y).reshape(-1, 81, 81)
                    np.add.at(blocks, faces.elements[active], K)
            if self.shift:
                shift_force = -float(np.sum(weight)) * touch.by_shift
                shift_stiffness = float(np.sum(closed)) * touch.by_shift**2
                column = np.einsum("fpn,fpa->fna", phi, (touch.by_shift * closed)[..., None] * slope)
                shift_column = np.bincount(
                    solid.dofs[faces.elements].ravel(), weights=column.ravel(), minlength=solid.size
                )
        reactions = solid.gather(forces)
        residual = self.Tt @ reactions
        if self.shift:
            residual[-1] += shift_force
        if blocks is None:
            return Balance(residual, reactions, None, kept, shift_force)
        reduced = (self.Tt @ solid.matrix(blocks) @ self.T).tocsr()
        if shift_column is not None:
            last, side = reduced.shape[0] - 1, self.Tt @ shift_column
            where = np.flatnonzero(side)
            ends = np.full(len(where), last)
            rows = np.concatenate([where, ends, [last]])
            columns = np.concatenate([ends, where, [last]])
            values = np.concatenate([side[where], side[where], [shift_stiffness]])
            reduced = reduced + sp.csr_matrix((values, (rows, columns)), shape=reduced.shape)
        return Balance(residual, reactions, reduced, kept, shift_force)

    def newton(self, state: State, most: float = math.inf, iterations: int = ITERATIONS) -> tuple[State, int]:
        """The equilibrium near a guess, and the iterations that it took.

        Args:
            state: the guess, at its pressure.
            most: longest step of a node in one iteration, m.
            iterations: the most of them.

        Raises:
            NoStateError: where it does not come to one.
        """
        state = dataclasses.replace(state)
        self.at(state.bend)
        unit = self.solid.modulus * float(np.mean(np.prod(2 * self.solid.boxes[1], axis=1)) ** (2 / 3))
        for iteration in range(iterations):
            self.watch(state.pressure)
            with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
                try:
                    now = self.balance(state)
                except np.linalg.LinAlgError as error:
                    raise NoStateError(str(error)) from None
            size = float(np.linalg.norm(now.residual))
            scale = max(float(np.linalg.norm(now.reactions)), 1e-3 * unit)
            if not math.isfinite(size) or size > 1e8 * scale:
                raise NoStateError("elements turned inside out")
            pressing = float(np.abs(now.kept[1]).max() / np.abs(self.solid.mass[:, 0]).max())
            if iteration and size < OUT_OF_BALANCE * scale and pressing < 1e-7:
                return state, iteration
            step = self.solve(now.matrix, -now.residual)
            moved = (self.T @ step).reshape(-1, 3)
            if not np.all(np.isfinite(moved)):
                raise NoStateError("the matrix is singular")
            strain = float(np.sqrt(np.max(np.sum((self.solid.gradients_of(moved) - np.eye(3)) ** 2, axis=(2, 3)))))
            part = min(1.0, most / max(float(np.abs(moved).max()), 1e-300), STRAIN / max(strain, 1e-300))
            state.q = state.q + part * self.solid.pressures(now.kept, moved)
            state.y = state.y + part * step
        raise NoStateError("too many iterations")

    def augmented(self, state: State, most: float = math.inf) -> State:
        """The same equilibrium with the contact pressures as multipliers: hardly any penetration is left."""
        if self.contact is None:
            return state
        for _ in range(AUGMENTED):
            pressures = self.touching(state)[1]
            if not np.any(pressures > 0):
                break
            state, _ = self.newton(dataclasses.replace(state, multipliers=pressures), most, PATIENCE)
        return state

    def follow(self, state: State, stops: Sequence[tuple[float, float]], most: float) -> Iterator[State]:
        """Equilibria at (pressure, Pa; curvature, 1/m), one after the other from a state on; ends early where there are
        none any more."""
        top = max(pressure for pressure, _ in stops) or 1.0
        bend = max(abs(curvature) for _, curvature in stops) or 1.0
        last: State | None = None
        direction, step = None, FIRST_STEP
        for pressure, curvature in stops:
            way = (pressure - state.pressure, curvature - state.bend)
            length = abs(way[0]) / top + abs(way[1]) / bend
            if direction != (way[0] != 0, way[1] != 0):
                last, direction, step = None, (way[0] != 0, way[1] != 0), FIRST_STEP
            done, start = 0.0, (state.pressure, state.bend)
            while done < 1 and length > 0:
                left = 1 - done
                ahead = step / length
                # No tiny step is left over before a stop.
                ahead = left if ahead > 0.999 * left else (0.5 * left if ahead > 0.6 * left else ahead)
                share = done + ahead if ahead < left else 1.0
                guess = dataclasses.replace(
                    state, pressure=start[0] + share * way[0], bend=start[1] + share * way[1], y=state.y, q=state.q
                )
                if last is not None:
                    before = abs(state.pressure - last.pressure) / top + abs(state.bend - last.bend) / bend
                    guess.y = state.y + ahead * length / before * (state.y - last.y)
                    guess.q = state.q + ahead * length / before * (state.q - last.q)
                try:
                    found, count = self.newton(guess, most)
                except NoStateError:
                    step = 0.4 * ahead * length
                    if step < LEAST_STEP:
                        return
                    continue
                last, state, done = state, found, share
                longer = GROWTH if count <= FEW_ITERATIONS else 1.0 if count <= FEW_ITERATIONS + 3 else 0.6
                step = ahead * length * longer
            try:
                state = self.augmented(state, most)
            except NoStateError:
                return
            yield state
