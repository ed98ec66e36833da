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
# # A parameter study
#
# How do the pressure that holds a cylinder, and the room up to the limit point, depend on the width and the
# thickness of the membrane? 49 x 46 designs, solved as one batch and labelled.

# %%
# %matplotlib inline
import tempfile
from pathlib import Path

import softgrip_jax as sg
from softgrip_jax import plots
from softgrip_jax.study import Grid, Range, sensitivity
from softgrip_jax.units import gram, kPa, mm

shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
grasp = sg.shell.Grasp(shell, radius=20 * mm, gap=5 * mm, mass=563 * gram, friction=0.96)
at = {"at": "required"}
study = sg.Study(
    grasp,
    ["shell.a", "shell.t_m"],
    [sg.Quantity("pressure", **at), sg.Quantity("limit_margin", **at)],
    Grid([Range(8 * mm, 24 * mm).points(49), Range(0.5 * mm, 2 * mm).points(46)]),
)
data = study.run()
print(data)

# %% [markdown]
# Designs without an answer are told from those with one, and why:

# %%
figure = plots.study(data)
figure

# %% [markdown]
# The Dataset is picked by name, and written to a file that any tool reads.

# %%
safe = data.where(data.limit_margin_at_required > 1.25)
best = safe.where(safe.pressure_at_required == safe.pressure_at_required.min(), drop=True)
print(f"least pressure with a margin of 1.25: {float(best.pressure_at_required.squeeze()) / kPa:.2f} kPa at")
print({name: f"{float(best[name].squeeze()) / mm:.2f} mm" for name in ("shell.a", "shell.t_m")})
data.to_netcdf(Path(tempfile.mkdtemp()) / "study.nc")

# %% [markdown]
# ## What matters
#
# Elasticities (1 % more of this is so many percent more of that) need no grid: they are exact derivatives. With
# tolerances, by the gradient and, to check it, by sampling:

# %%
matters = sensitivity(
    {"grasp": grasp},
    ["shell.a", "shell.b", "shell.t_m", "shell.material.mu", "gap", "radius"],
    [sg.Quantity("pressure", **at)],
    tolerances=[0.2 * mm, 0.2 * mm, 0.05 * mm, 5 * kPa, 0.5 * mm, 0.2 * mm],
    samples=2000,
)
print(matters.elasticity.to_series().round(3).to_string())
spread = float(matters.deviation_by_gradient[0]) / kPa, float(matters.deviation_by_sampling[0]) / kPa
print(f"standard deviation of the pressure: {spread[0]:.3f} kPa by the gradient, {spread[1]:.3f} by sampling")
