"""A state of one mesh as the first guess on a finer one, whose cells lie within its cells."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from .equilibrium import Model, State
from .solid import Solid


def shape_functions(
    solid: Solid, element: int, places: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n nodes"], Float[np.ndarray, "n nodes 3"]]:
    """Shape functions of a box at places within it, and their derivatives, 1/m, by products of parabolas.

    Args:
        solid: whose elements are boxes.
        element: its number.
        places: m.
    """
    middle, half = (part[element] for part in solid.boxes)
    nodes = np.rint((solid.X[solid.cells[element]] - middle) / half).astype(int) + 1  # 0, 1, 2 along each axis
    s = (places - middle) / half
    value = np.stack([0.5 * s * (s - 1), 1 - s * s, 0.5 * s * (s + 1)])
    slope = np.stack([s - 0.5, -2 * s, s + 0.5]) / half
    N = [value[nodes[:, axis], :, axis].T for axis in range(3)]
    D = [slope[nodes[:, axis], :, axis].T for axis in range(3)]
    gradients = np.stack([D[0] * N[1] * N[2], N[0] * D[1] * N[2], N[0] * N[1] * D[2]], axis=-1)
    return N[0] * N[1] * N[2], gradients


def element_at(solid: Solid, place: Float[np.ndarray, " 3"]) -> int:
    """An element that holds a place (m)."""
    middle, half = solid.boxes
    return int(np.argmin(np.max(np.abs(middle - place) / half, axis=1)))


def place_of(solid: Solid, u: Float[np.ndarray, "nodes 3"], place: Float[np.ndarray, " 3"]) -> np.ndarray:
    """Where a point of the solid (m) has gone, m."""
    element = element_at(solid, place)
    values, _ = shape_functions(solid, element, place[None])
    return values[0] @ (solid.X + u)[solid.cells[element]]


def gradient_at(solid: Solid, u: Float[np.ndarray, "nodes 3"], place: Float[np.ndarray, " 3"]) -> np.ndarray:
    """F at a point of the solid (m)."""
    element = element_at(solid, place)
    _, gradients = shape_functions(solid, element, place[None])
    return np.eye(3) + u[solid.cells[element]].T @ gradients[0]


def transferred(coarse: Model, state: State, fine: Model) -> State:
    """A state of a coarse mesh on a fine one."""
    a, b = coarse.solid, fine.solid
    coarse.at(state.bend)
    fine.at(state.bend)
    u, v = coarse.displacement(state.y), np.zeros_like(b.X)
    q = np.zeros((len(b.cells), 4))
    parents = np.array([element_at(a, middle) for middle in b.boxes[0]])
    for parent in np.unique(parents):
        children = np.flatnonzero(parents == parent)
        nodes = b.cells[children]
        values, _ = shape_functions(a, int(parent), b.X[nodes.ravel()])
        v[nodes.ravel()] = values @ u[a.cells[parent]]
        middle, half = a.boxes[0][parent], a.boxes[1][parent]
        q[children, 0] = state.q[parent, 0] + ((b.boxes[0][children] - middle) / half) @ state.q[parent, 1:]
        q[children, 1:] = state.q[parent, 1:] * b.boxes[1][children] / half
    lengths = np.asarray(fine.T.multiply(fine.T).sum(axis=0)).ravel()
    y = (fine.Tt @ (v.ravel() - fine.g)) / np.where(lengths > 0, lengths, 1.0)
    if fine.shift:
        y[-1] = state.y[-1]
    multipliers = None
    if fine.contact is not None and coarse.contact is not None and coarse.contact.faces is not None:
        from scipy.spatial import KDTree

        pressures = coarse.touching(state)[1].ravel()
        known = KDTree(a.at(coarse.contact.faces, np.zeros_like(a.X)).reshape(-1, 3))
        asked = b.at(fine.contact.faces, np.zeros_like(b.X)).reshape(-1, 3)
        multipliers = pressures[known.query(asked)[1]].reshape(fine.contact.faces.areas.shape)
    return State(state.pressure, y, q, multipliers, state.bend)
