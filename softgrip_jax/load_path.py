"""The ways to a state: coordinates along a path, and the pressure and the part of the external loads at each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]

LATER = 2.0
"""Where the moment of type A and C begins to grow with x rather than with its square: 2.3 and 1.9."""
BEGINNING = 1e-3
"""Of the way under pressure, where it begins to be followed."""

Goal = Callable[[Any, Vector, dict[str, Array]], Scalar]
"""(what it needs, point u, what is observed there) -> a number that rises through zero where a search ends."""


class PathEnd(NamedTuple):
    """Where a search along the path ended, and why."""

    u: Vector
    status: Int[Array, ""]
    iterations: Int[Array, ""]
    reason: Int[Array, ""]
    detail: Scalar


class LoadPath(eqx.Module):
    """Pressures, Pa, and their coordinates on the path, which begins with the external loads."""

    loading: Scalar
    """Where the loads have arrived and the pressure begins to act: 1, more for loads that are large, 0 without any."""
    begin: Scalar
    step: Scalar
    """A typical change of pressure: the unit along the path."""
    end: Scalar
    """Where the actuator's own model ends."""
    early: Scalar
    """How fast the way goes at first: the place is x (x + early) / (x + LATER) at begin + step x. What chambers do
    grows with the square of x before it grows with x, and so does the place where this is small; at LATER it is x."""

    def coordinate_of(self, pressure: Scalar) -> Scalar:
        """The last entry of u at a pressure."""
        x = jnp.maximum(pressure - self.begin, 0) / self.step
        return self.loading + x / (1 + (LATER - self.early) / (x + self.early))  # inf at inf: some walls have no end

    def last(self) -> Scalar:
        """The coordinate of `end`."""
        return self.coordinate_of(self.end)

    def pressure_at(self, u: Vector, wanted: Bool[Array, ""] | bool = True) -> Scalar:
        """The pressure at a point of the path; of no meaning, and at no cost, where it is not wanted."""
        place = jnp.maximum(u[-1] - self.loading, 0)
        half = 0.5 * (place - self.early)
        return self.begin + self.step * (half + jnp.sqrt(half * half + LATER * place))

    def load_at(self, u: Vector) -> Any:
        """What the equations are given of the pressure there."""
        return self.pressure_at(u)

    def load_factor_at(self, u: Vector) -> Scalar:
        """The part of the loads there: they arrive with zero slope, no kink for the tangent."""
        arrived = jnp.where(self.loading > 0, u[-1] / jnp.where(self.loading > 0, self.loading, 1), 1)
        return 1 - (1 - jnp.minimum(arrived, 1)) ** 2


class GentlePath(LoadPath):
    """A way on which what the pressure does grows with it from the first on: after other loads it begins with zero
    slope, as y^2 / (y + early), where a straight way would have a kink that no step can pass. Without them early is 0,
    and the way is straight."""

    def coordinate_of(self, pressure):
        x = jnp.maximum(pressure - self.begin, 0) / self.step
        return self.loading + 0.5 * (x + jnp.sqrt(x * (x + 4 * self.early)))

    def pressure_at(self, u, wanted=True):
        y = jnp.maximum(u[-1] - self.loading, 0)
        return self.begin + self.step * y * y / jnp.where(y > 0, y + self.early, 1.0)


class Ray(LoadPath):
    """A straight way through pressures and parts of the loads; `loading` is where the loads arrive."""

    first: Scalar
    """The pressure at coordinate 0, Pa."""
    rate: Scalar
    """Pa per unit of the path."""
    load_factor: Scalar
    """The part of the loads at coordinate 0."""
    growth: Scalar
    """... and its growth per unit of the path."""

    def pressure_at(self, u, wanted=True):
        return self.first + self.rate * u[-1]

    def load_factor_at(self, u):
        return self.load_factor + self.growth * u[-1]


def proportional(span: LoadPath, pressure: Scalar) -> Ray:
    """From nothing at all to all of the loads and a pressure (Pa) at once."""
    length = jnp.maximum(jnp.maximum(span.loading, pressure / span.step), 1.0)
    zero = jnp.zeros_like(length)
    common = (length, span.begin, span.step, span.end, span.early)
    return Ray(*common, first=zero, rate=pressure / length, load_factor=zero, growth=1 / length)


def onwards(ray: Ray, pressure: Scalar, down: Bool[Array, ""] | bool = False) -> Ray:
    """From a pressure (Pa) with all of the loads to higher ones, or to lower ones."""
    zero = jnp.zeros_like(ray.loading)
    common = (zero, ray.begin, ray.step, ray.end, ray.early)
    return Ray(*common, first=pressure, rate=jnp.where(down, -1.0, 1.0) * ray.step, load_factor=zero + 1, growth=zero)


def to_moderate(span: LoadPath) -> tuple[Ray, Scalar]:
    """To all loads at a moderate pressure (Pa), one that bends by about a radian: there questions that name no pressure
    begin where loads and pressure grow together."""
    moderate = jnp.minimum(span.begin + span.step, 0.5 * (span.begin + span.end))
    return proportional(span, moderate), moderate


def start_of(scene: Any, span: LoadPath) -> Vector:
    """The unloaded state of a scene, at the beginning of its path."""
    return jnp.append(scene.unloaded_state(), jnp.zeros_like(span.loading))


def begun(scene: Any, u: Vector, span: LoadPath, most: Scalar | float = jnp.inf, by: Scalar | float = 1.0) -> Vector:
    """A little further where the pressure begins to act, at most to a coordinate: the path's direction shows there.
    by: part of the usual way."""
    further = jnp.minimum(span.loading + BEGINNING * by, most)
    u = u.at[-1].set(jnp.where(u[-1] >= span.loading, further, u[-1]))
    return u.at[:-1].set(scene.begun_state(u[:-1], span.load_at(u)))


def to_coordinate(coordinate: Scalar, u: Vector, _: dict[str, Array]) -> Scalar:
    """The goal of a search for a coordinate of the path."""
    return u[-1] - coordinate
