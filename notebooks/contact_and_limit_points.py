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
# # Contact and limit points
#
# A neo-Hookean membrane that is inflated freely has a largest pressure. Beyond it no equilibrium exists: that is
# physics, not a solver that gave up, and a result here, never an exception.

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
shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
free = sg.shell.Free(shell)
limit = sg.limit_pressure(free)
print(f"{limit / kPa:.4f} kPa")
for share in (0.999, 1.001):
    print(share, sg.Status(int(sg.solve(free, share * limit).status)).message)

# %% [markdown]
# `branch` is the curve through the limit point: what a test rig follows that gives the volume instead of the
# pressure.

# %%
fig, ax = plt.subplots(figsize=(5, 3.2), layout="constrained")
materials = {
    "neo-Hookean": sg.NeoHookean(mu=175 * kPa),
    "Gent, $J_m$ = 12": sg.Gent(mu=175 * kPa, j_m=12.0),
}
for name, material in materials.items():
    scene = sg.shell.Free(sg.FlatShell(16 * mm, 43 * mm, 1.1 * mm, material))
    curve = sg.branch(scene, 300)
    ax.plot(np.asarray(curve.inflation) / mm, np.asarray(curve.pressure) / kPa, label=name)
    peak = sg.limit_pressure(scene)
    if np.isfinite(peak):
        ax.plot(np.asarray(sg.solve(scene, peak * (1 - 1e-12)).inflation) / mm, peak / kPa, "ko", markersize=4)
ax.set(xlim=(0, 60), ylim=(0, 30), xlabel="inflation (mm)", ylabel="pressure (kPa)")
ax.legend()
plt.show()

# %% [markdown]
# ## Contact begins
#
# Against a plane there is nothing until the membrane touches, and the force then rises from zero.

# %%
plane = sg.shell.FlatContact(shell, distance=5 * mm)
begin = sg.contact_pressure(plane)
states = jax.vmap(lambda p: sg.solve(plane, p))(begin * jnp.array([0.9, 1.0, 1.001, 1.1]))
print(f"contact from {begin / kPa:.4f} kPa")
print([sg.Status(int(s)).name for s in states.status], np.asarray(states.force))

# %%
figure = plots.draw(sg.solve(sg.shell.CylinderContact(shell, radius=20 * mm, gap=5 * mm), 15 * kPa))
figure

# %% [markdown]
# ## A batch with members that have no answer
#
# They hold NaN, pass zero gradient, and leave their neighbours alone.

# %%
slopes = jax.vmap(jax.grad(lambda p: sg.solve(free, p).inflation))(jnp.array([5.0, 15.0, 25.0]) * kPa)
print(np.asarray(slopes) * kPa / mm, "mm per kPa")

# %% [markdown]
# The limit pressure is smooth in the design, so a search can climb back to where equilibria exist:

# %%
slope = jax.grad(sg.limit_pressure)(free)
print(f"{slope.shell.t_m * mm / kPa:.3f} kPa per mm of thickness")
assert abs(slope.shell.t_m * shell.t_m / limit - 1) < 1e-9  # in proportion to mu t_m

# %% [markdown]
# ## The fold of a held finger
#
# A finger whose tip is held ends in a fold too. Along the branch, by arc length. Before the fold this finger bends back
# so far near its clamp that neighbouring chambers would meet at their tops; here that rule is ignored.

# %%
held = sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"), ignored_rules=("chambers_apart",))
curve = sg.branch(held)
good = np.asarray(curve.status) == sg.Status.OK
top = int(np.argmax(np.where(good, np.asarray(curve.pressure), 0)))
fig, ax = plt.subplots(figsize=(5, 3.2), layout="constrained")
p, force = np.asarray(curve.pressure)[good] / kPa, np.asarray(curve.tip_force)[good]
(line,) = ax.plot(p[: top + 1], force[: top + 1])
ax.plot(p[top:], force[top:], "--", color=line.get_color())
ax.set(xlabel="pressure (kPa)", ylabel="tip force (N)", title=f"fold at {p[top]:.1f} kPa")
plt.show()
