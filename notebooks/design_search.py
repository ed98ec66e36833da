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
# # A design search
#
# Two flat shells hold a cylinder of 563 g (the thesis's gripper, its table 6.1). Which dimensions hold it at the
# least pressure, with room to the limit point and moderate strain?

# %%
# %matplotlib inline
import matplotlib.pyplot as plt
import numpy as np

import optim
import softgrip_jax as sg
from softgrip_jax import plots
from softgrip_jax.units import gram, kPa, mm

plt.rcParams.update(plots.figures.STYLE)
shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
grasp = sg.shell.Grasp(shell, radius=20 * mm, gap=5 * mm, mass=563 * gram, friction=0.96)
print(sg.pressure_for(grasp))

# %% [markdown]
# What may move (the bounds are what can be made and mounted), what is wanted, what must hold:

# %%
space = optim.Space(
    {"grasp": grasp},
    [
        optim.Variable("shell.a", 8 * mm, 24 * mm),
        optim.Variable("shell.b", 25 * mm, 50 * mm),
        optim.Variable("shell.t_m", 0.8 * mm, 2 * mm),
        optim.Variable("gap", 2 * mm, 12 * mm),
    ],
)
pressure, margin, stretch = (
    optim.Quantity(name, at="required", scene="grasp") for name in ("pressure", "limit_margin", "stretch")
)
problem = optim.Problem(
    space,
    goals=[optim.Goal("minimise", pressure)],
    limits=[optim.Limits(margin, low=1.25), optim.Limits(stretch, high=1.3)],
)

# %% [markdown]
# From 32 starts at once. The physics is compiled once, with all its derivatives.

# %%
found = optim.search(problem, starts=32, steps=10, finishes=4)
best = found.best
before, after = (float(d.values[0]) / kPa for d in (found.reference, best))
print(f"{before:.2f} kPa before, {after:.2f} kPa after, {found.solves} designs solved")
print({name: round(float(x) / mm, 3) for name, x in zip(space.names, best.x, strict=True)}, "mm")
print("held where it is by:", ", ".join(best.active))

# %%
history = found.history["best_objective"]
fig, ax = plt.subplots(figsize=(5, 2.8), layout="constrained")
ax.plot(np.arange(1, len(history) + 1), history * before, "o-", markersize=3)
ax.axhline(after, color="0.5", linewidth=0.8)
ax.set(xlabel="step", ylabel="least pressure so far (kPa)", title="descent, and what the finish reaches")
plt.show()

# %%
better = space.scenes_at(best.x)["grasp"]
figure = plots.compare({"before": sg.pressure_for(grasp), "after": sg.pressure_for(better)})
figure

# %% [markdown]
# The same search from the shell is `softgrip design configs/shell_grasp.toml`. Relaxing a bound that does not hold
# the design gains nothing; each one that does is a question to the workshop.
