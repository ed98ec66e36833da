"""What pressure does to a chamber, as a model of a user's own: `drive=MyWall(...)`."""

from __future__ import annotations

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..finger import PneuNet

Scalar = Float[Array, ""]


class WallModel(eqx.Module):
    """The moment that a pressure in two neighbouring chambers exerts on the cover between them.

    Written for one chamber at one pressure, with functions that JAX can differentiate. Its float leaves can be varied.
    How to write one of your own: docs/extending/wall-model.md.

    Source: thesis 4.3.1 for what a chamber does.

    Examples:
        >>> class Piston(sg.pneunet.WallModel):
        ...     def end_moment(self, finger, pressure, inclination):
        ...         return 4 * finger.a * finger.b * pressure * (0.5 * finger.H + finger.a)
        ...     def largest_pressure(self, finger):
        ...         return 60 * kPa + 0 * finger.a
        >>> print(f"{Piston().end_moment(sg.PneuNet.table_5_1('A'), 1 * kPa, 0.0):.4f} N m")
        0.0012 N m
    """

    @abc.abstractmethod
    def end_moment(self, finger: PneuNet, pressure: Scalar, inclination: Scalar) -> Scalar:
        """M_T, N m, positive in the bending direction, zero below contact.

        Args:
            finger: with one chamber's dimensions.
            pressure: Pa.
            inclination: theta_s of the walls, rad, zero or more.
        """

    @abc.abstractmethod
    def largest_pressure(self, finger: PneuNet) -> Scalar:
        """Where the model ends, Pa; finite."""

    def contact_pressure(self, finger: PneuNet) -> Scalar:
        """Where the walls begin to press on each other, Pa; zero by default."""
        return jnp.zeros_like(finger.L)
