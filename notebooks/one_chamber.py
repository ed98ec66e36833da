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
# # One chamber
#
# A pneu-net finger is a row of air chambers on a cover. Inflated, the walls of two neighbours press on each other,
# and that pushes the cover into a bend. This notebook looks at one such pair: the finger of the thesis's table 5.1,
# type A.

# %%
# %matplotlib inline
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import softgrip_jax as sg
from softgrip_jax import plots
from softgrip_jax.units import kPa, mm

plt.rcParams.update(plots.figures.STYLE)
finger = sg.PneuNet.table_5_1("A")
print(f"wall {2 * finger.a / mm:g} x {2 * finger.b / mm:g} x {finger.t_m / mm:g} mm, gap {2 * finger.h_x / mm:g} mm")

# %% [markdown]
# `chamber` solves the contact of two walls at a pressure. The force acts at the lever arm above the cover; the end
# moment is what the beam feels.

# %%
touching = sg.pneunet.chamber(finger, 31 * kPa)
print(touching)

# %%
figure = plots.draw(touching)
figure

# %% [markdown]
# Nothing happens until the walls touch:

# %%
print(f"first contact at {sg.pneunet.contact_pressure(finger) / kPa:.2f} kPa")
print(sg.Status(int(sg.pneunet.chamber(finger, 2 * kPa).status)).message)

# %% [markdown]
# A curve is one call under `vmap`. As the finger bends the walls incline by $\theta_s$ and push much less; at which
# angle they stand is therefore part of the solution of a bent finger.

# %%
pressures = np.linspace(2, 45, 87) * kPa
curve = jax.jit(jax.vmap(jax.vmap(lambda p, lean: sg.pneunet.chamber(finger, p, lean), (0, None)), (None, 0)))
inclinations = np.array([0.0, 0.05, 0.1, 0.15])
moments = np.asarray(curve(jnp.asarray(pressures), jnp.asarray(inclinations)).end_moment)

fig, ax = plt.subplots(figsize=(5, 3.2), layout="constrained")
for k, (lean, moment) in enumerate(zip(inclinations, moments, strict=True)):
    ax.plot(pressures / kPa, moment * 1e3, color=plt.cm.viridis(0.3 * k), label=f"{lean:g} rad")
ax.set(xlabel="pressure (kPa)", ylabel="end moment (N mm)", title="Inclined walls push less")
ax.legend(title="inclination")
plt.show()

# %% [markdown]
# What matters for the moment? The gradient answers for every dimension at once.

# %%
slope = jax.grad(lambda f: sg.pneunet.chamber(f, 31 * kPa).end_moment)(finger)
moment = touching.end_moment
for name in ("a", "b", "h_x", "t_m", "h_L", "H"):
    elasticity = float(getattr(slope, name) * getattr(finger, name) / moment)
    print(f"1 % more {name:4} changes the end moment by {elasticity:+.2f} %")

# %% [markdown]
# The wall is thick ($t_m/a = 0.22$), and against finite elements the force is 40 % low: see the limits of the models.
