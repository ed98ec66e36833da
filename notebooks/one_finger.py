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
# # One finger
#
# The finger of table 5.1, type A: how far it bends in free space, and how hard it presses when its tip is held.

# %%
# %matplotlib inline
import dataclasses

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import softgrip_jax as sg
from softgrip_jax import plots
from softgrip_jax.units import degree, kPa, mm

plt.rcParams.update(plots.figures.STYLE)
finger = sg.PneuNet.table_5_1("A")

# %% [markdown]
# ## Free, without weight
#
# Each part bends to a circular arc, and its chambers incline as it bends: one scalar root, no integration.

# %%
free = sg.pneunet.Free(finger, weight=(0.0, 0.0))
bent = sg.solve(free, 31 * kPa)
print(bent)

# %%
figure = plots.draw(bent)
figure

# %% [markdown]
# How the walls incline as the finger bends matters more than the section law. `"segment"` takes half the angle between
# adjacent chambers, `"gap"` the turn over the gap alone; the thesis does not say which.

# %%
pressures = np.linspace(8, 36, 57) * kPa
fig, ax = plt.subplots(figsize=(5, 3.2), layout="constrained")
for section, inclination, style in (("exact", "segment", "-"), ("thesis", "segment", ":"), ("exact", "gap", "--")):
    scene = sg.pneunet.Free(finger, weight=(0.0, 0.0), section=section, inclination=inclination)
    curve = sg.path(scene, pressures)
    label = f"{section} law, inclination by {inclination}"
    ax.plot(pressures / kPa, np.asarray(curve.tip_angle) / degree, style, label=label)
ax.set(xlabel="pressure (kPa)", ylabel="rotation of the tip (deg)")
ax.legend()
plt.show()

# %% [markdown]
# ## The tip held
#
# `TipContact` holds the tip at a height. The pressure for a wanted force is solved for, without stepping:

# %%
held = sg.pneunet.TipContact(finger)
pressing = sg.pressure_for(held, tip_force=0.1)
print(pressing)

# %%
figure = plots.draw(pressing)
figure

# %% [markdown]
# ## Two laws of what pushes
#
# So far the thesis's chambers push. By finite elements of chamber, walls, rims and cover together a finger is pushed
# about four times as hard; `drive="cell"` is the law that is near those. The tip forces that the thesis measured lie
# near its own chambers, and nobody knows why, so both are told, and a finger that was built is calibrated. The points
# are a whole finger of twelve chambers, 72 mm, as one solid.

# %%
pressures, twelve = np.linspace(3, 20, 35) * kPa, dataclasses.replace(finger, L=72 * mm)
fig, ax = plt.subplots(figsize=(5, 3.2), layout="constrained")
for drive in ("thesis", "cell"):
    curve = sg.path(sg.pneunet.TipContact(twelve, drive=drive), pressures)
    ax.plot(pressures / kPa, np.asarray(curve.tip_force), label=f'drive="{drive}"')
by_elements = np.array([[5, 0.0305], [10, 0.0872], [15, 0.1543], [20, 0.2277]])
ax.plot(*by_elements.T, "ko", markersize=4, label="finite elements")
ax.set(xlabel="pressure (kPa)", ylabel="tip force (N)")
ax.legend()
plt.show()

# %%
by_cell = sg.solve(sg.pneunet.TipContact(finger, drive="cell"), 20 * kPa)
figure = plots.draw(by_cell)
figure

# %% [markdown]
# ## The simplest model
#
# `Linear` is the finger of linear beam theory with walls of small strain: explicit, and right for what bends little.
# Its walls push much harder than the arcs of the thesis's chambers, from the pressure on at which they touch: it is a
# first guess of a finger, no model of one.

# %%
linear = jax.vmap(lambda p: sg.solve(sg.pneunet.Linear(finger), p))(jnp.array([20.0, 25.0, 31.0]) * kPa)
print("rotation of the tip, linear:", np.asarray(linear.tip_angle) / degree, "deg")
print(f"length of the finger {finger.L / mm:g} mm")
