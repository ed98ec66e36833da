"""Pressures at which Newton's method is tried before a path is followed."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..load_path import LoadPath
from ..numerics.continuation import Climb


def climb_to(place: Float[Array, ""], scene: Any, span: LoadPath) -> Climb | None:
    """Pressures up to a coordinate of the way; None for a scene that cannot tell whether to believe the method."""
    is_light = scene.is_lightly_loaded()
    if is_light is None:
        return None

    def is_sure(u, args):
        scene, _, span = args
        return scene.is_the_only_state(u[:-1], span.pressure_at(u))

    return Climb(jnp.append(scene.unloaded_state(), span.loading), place, is_light, is_sure)
