"""Where the energy membrane rests on an object, and the forces there."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..flat_shell import Scalar
from ..obstacles import length
from .basis import Vector
from .maps import shape_observables
from .sheet import local

CONTACT = {
    "force": "force",
    "force_x": "force",
    "force_y": "force",
    "force_z": "force",
    "moment_x": "moment",
    "moment_y": "moment",
    "moment_z": "moment",
    "friction_moment": "moment",
    "contact_area": "area",
}
"""What is observed of any contact, beside the shape of the membrane."""
HALF_SIDE = np.sqrt(3) / 2
"""Of a rectangle, over the half axis of the ellipse that has the same second moment."""


class Resting(NamedTuple):
    """The membrane at the contact points."""

    places: Float[Array, "k 3"]
    """Of its outer face, m."""
    pushes: Float[Array, " k"]
    """Normal forces, N."""
    shares: Float[Array, " k"]
    """Of their sum; zero where nothing presses."""


def resting_on(scene: Any, y: Vector, contact_pressures: Float[Array, " k"]) -> Resting:
    """Where the membrane rests on the object, and how much."""
    shell, table = scene.shell, scene.functional.touching
    aspect, thickness = shell.a / shell.b, shell.t_m / shell.a

    def face(e, point):
        return shell.a * local(e, point, aspect).face(thickness)

    places = jax.vmap(face)(scene.functional.deformed(y, table), table.points)
    pushes = contact_pressures * scene.functional.contact_weights(scene) * scene.unit() * shell.a**2
    total = jnp.sum(pushes)
    return Resting(places, pushes, pushes / jnp.where(total > 0, total, 1.0))


def contact_observables(
    scene: Any, y: Vector, contact_pressures: Float[Array, " k"], pressure: Scalar
) -> dict[str, Array]:
    """What is observed of every contact: CONTACT, and the shape of the membrane."""
    resting = resting_on(scene, y, contact_pressures)
    places, pushes = resting.places, resting.pushes
    forces = pushes[:, None] * -jax.vmap(jax.grad(scene.body.distance))(places)
    # The grid of a symmetric scene covers one side: what the other side takes away again is left out.
    across, along = scene.symmetry in ("across", "both"), scene.symmetry in ("along", "both")
    force = jnp.sum(forces, axis=0) * np.array([not across, not along, True])
    moment = jnp.sum(jnp.cross(places, forces), axis=0) * np.array([not along, not across, not (across or along)])
    total = jnp.sum(pushes)
    resultants = {f"force_{axis}": force[k] for k, axis in enumerate("xyz")}
    resultants |= {f"moment_{axis}": moment[k] for k, axis in enumerate("xyz")}
    # What turns about the z axis through the middle of the contact: zero by symmetry, or where the forces balance.
    middle = (resting.shares @ places)[:2] * np.array([not across, not along])
    arms = jax.vmap(length)(places[:, :2] - middle[None])
    resultants["friction_moment"] = pushes @ arms
    return {"force": total, **resultants, "contact_area": total / pressure} | shape_observables(scene, y)


def half_axis(resting: Resting, at: Float[Array, " k"], centred: bool) -> Array:
    """2 sqrt(mean of squares), weighted by forces; about their mean, or about zero where symmetry has it there."""
    apart = at if centred else at - resting.shares @ at
    square = resting.shares @ apart**2
    return jnp.where(square > 0, 2 * jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
