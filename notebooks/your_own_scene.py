# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Your own scene
#
# A gripper that the package does not know: a **round pad**, a circular membrane of radius $a$ that is pressed
# against a plane at the distance $d$. A few fields, the equations for *one* point, and a list of what is observed,
# are all that it takes. Everything else (statuses, exact derivatives, batches, the inverse problem, the limit point,
# configs, the command line and the design search) comes from the base class. No other file is touched.
#
# The physics, in the manner of the thesis's square membrane (its equations 3.8, 3.9, 3.11 and 4.7): the profile is
# arc, flat, arc with the clamp angle $\theta$; the membrane is stretched alike in both directions;
#
# $$R = \frac{d}{1-\cos\theta},\quad
#   \lambda = 1 + \frac da\left(\frac{\theta/2}{\sin^2(\theta/2)} - \cot\frac\theta2\right),\quad
#   p = \frac{2T(\lambda)}{R},\quad
#   c = a - d\cot\frac\theta2,\quad F = \pi c^2p.$$

# %%
# %matplotlib inline
import os
import tempfile
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import optim
import softgrip_jax as sg
from softgrip_jax.curve_scene import CurveScene
from softgrip_jax.fields import part, positive
from softgrip_jax.materials import Material
from softgrip_jax.membrane import equilibrium_pressure, flat_contact_stretch
from softgrip_jax.scene import Scalar
from softgrip_jax.units import kPa, mm


# %%
class RoundPad(CurveScene):
    """A circular membrane on a plane. radius: a, m; distance: d, m; t_m: thickness, m. The angle is theta."""

    radius: Scalar = positive("length")
    distance: Scalar = positive("length")
    t_m: Scalar = positive("length")
    material: Material = part(Material)

    OBSERVABLES = {"force": "force", "contact_radius": "length", "stretch": "number"}

    def interval(self):
        """From where the free cap touches the plane to where the arcs are half circles."""
        return 2 * jnp.arctan(self.distance / self.radius), jnp.pi + 0 * self.radius

    def stretch(self, angle):
        return flat_contact_stretch(angle, self.distance / self.radius)

    def load(self, angle):
        """p = 2 T / R."""
        curvature = (1 - jnp.cos(angle)) / self.distance
        stretch = self.stretch(angle)
        return equilibrium_pressure(self.material, self.t_m, stretch, stretch, curvature, curvature)

    def pressure_scale(self):
        return self.material.shear_modulus() * self.t_m / self.radius

    def observe(self, angle, pressure):
        c = self.radius - self.distance / jnp.tan(0.5 * angle)
        return {"force": jnp.pi * c**2 * pressure, "contact_radius": c, "stretch": self.stretch(angle)}


# %% [markdown]
# That is the whole scene. The kinds of quantity ("length", "force") give its keys their units and its rules their
# words.
#
# ## Solve

# %%
pad = RoundPad(radius=16 * mm, distance=5 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
print(sg.solve(pad, 15 * kPa))

# %%
print(sg.pressure_for(pad, force=5.0))
print(f"first contact at {sg.contact_pressure(pad) / kPa:.3f} kPa")
print(f"the model ends at {sg.limit_pressure(pad) / kPa:.1f} kPa")

# %% [markdown]
# ## Gradient and batch
#
# A derivative by every number of the scene, checked by a finite difference, and a batch in which one member has no
# answer.

# %%
slope = jax.grad(lambda pad: sg.solve(pad, 15 * kPa).force)(pad)
step = 1e-6 * mm
thicker, thinner = (RoundPad(16 * mm, 5 * mm, 1.1 * mm + s, sg.NeoHookean(175 * kPa)) for s in (step, -step))
difference = (sg.solve(thicker, 15 * kPa).force - sg.solve(thinner, 15 * kPa).force) / (2 * step)
print(f"dF/dt_m = {slope.t_m * mm:.6f} N/mm, by differences {difference * mm:.6f} N/mm")
assert abs(slope.t_m / difference - 1) < 1e-6

batch = jax.vmap(lambda distance: sg.solve(RoundPad(16 * mm, distance, 1.1 * mm, pad.material), 15 * kPa))(
    jnp.array([3.0, 5.0, 40.0]) * mm
)
print(batch, np.asarray(batch.force).round(4), "N")

# %% [markdown]
# ## Search
#
# The pad that presses with 5 N at the least pressure and is stretched by 4 % at most.

# %%
at = ("force", 5.0)
quantities = {name: optim.Quantity(name, at=at, scene="pad") for name in ("pressure", "stretch")}
problem = optim.Problem(
    optim.Space(
        {"pad": pad},
        [
            optim.Variable("radius", 8 * mm, 20 * mm),
            optim.Variable("distance", 3 * mm, 10 * mm),
            optim.Variable("t_m", 0.8 * mm, 2 * mm),
        ],
    ),
    goals=[optim.Goal("minimise", quantities["pressure"])],
    limits=[optim.Limits(quantities["stretch"], high=1.04)],
)
best = optim.search(problem, starts=8, steps=20, finishes=2).best
print({name: round(float(x) / mm, 3) for name, x in zip(problem.space.names, best.x, strict=True)}, "mm")
print(f"{best.values[0] / kPa:.3f} kPa, stretch {best.values[1]:.3f}; held by {', '.join(best.active)}")

# %% [markdown]
# ## Command line
#
# A config names the scene by its class; the keys follow from the fields. In a file `pad.py` of your own, end with
#
#     if __name__ == "__main__":
#         from softgrip_jax.cli import main
#
#         main()
#
# and `python pad.py solve pad.toml`, `python pad.py design pad.toml` and all other commands know your scene. Here in
# the notebook:

# %%
from softgrip_jax.cli import run

os.chdir(tempfile.mkdtemp())
Path("pad.toml").write_text("""
[scene]
type = "RoundPad"
radius_mm = 16
distance_mm = 5
t_m_mm = 1.1
material = { preset = "dragon_skin_20_shell" }

[solve]
force_N = 5
""")
assert run(["solve", "pad.toml"]) == 0

# %% [markdown]
# Mistakes are told in one sentence, with exit code 2:

# %%
Path("wrong.toml").write_text(Path("pad.toml").read_text().replace("radius_mm = 16", "radius_cm = 1.6"))
assert run(["solve", "wrong.toml"]) == 2
