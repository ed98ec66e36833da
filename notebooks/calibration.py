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
# # A calibration
#
# The modulus of a shell's membrane from its free inflation, and the force on a plane predicted with it, as the
# thesis does with experiments (section 6.2). The measurements here are finite elements with $\mu$ = 175 kPa, which
# come with the project: so the truth is known, and what is found besides is the error of the arc model.

# %%
# %matplotlib inline
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import optim
import softgrip_jax as sg
from optim.calibration.data import Column, read_columns
from softgrip_jax import plots
from softgrip_jax.units import kPa, mm

plt.rcParams.update(plots.figures.STYLE)
here = Path("..") / "configs" / "data"
curves = {}
for name, column in (("free", Column("inflation_mm", "length", "mm")), ("contact", Column("force_N", "force", "N"))):
    table, _ = read_columns(here / f"fe_shell_{name}.csv", [Column("pressure_kPa", "pressure", "kPa"), column])
    curves[name] = table.T
print({name: len(x) for name, (x, _) in curves.items()}, "points")

# %%
guess = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=200 * kPa))
models = {"free": sg.shell.Free(guess), "contact": sg.shell.FlatContact(guess, distance=5 * mm)}
data = [
    optim.Curve("free inflation", "free", "inflation", "length", *curves["free"]),
    optim.Curve("force on a plane", "contact", "force", "force", *curves["contact"], fit=False),
]
mu = optim.Variable("shell.material.mu", 20 * kPa, 2000 * kPa, "log")
fit = optim.calibrate(optim.Fitting(models, [mu], data))
print(f"mu = {fit.x[0] / kPa:.1f} kPa, 95 % interval {fit.low[0] / kPa:.1f} to {fit.high[0] / kPa:.1f} kPa")
print(f"misfit: inflation {fit.rmse(0) / mm:.2f} mm, force (predicted) {fit.rmse(1):.2f} N")
print(*fit.notes, sep="\n")

# %%
fig, axes = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
fitted = fit.modules()
for ax, (name, (x, y)), (quantity, unit, label) in zip(
    axes, curves.items(), (("inflation", mm, "inflation (mm)"), ("force", 1.0, "force (N)")), strict=True
):
    p = np.linspace(0.02, 1, 60) * x.max()
    for scene, style, text in ((fitted[name], "-", "arc model, fitted"), (models[name], ":", "first guess, 200 kPa")):
        ax.plot(p / kPa, np.asarray(sg.path(scene, p).observables[quantity]) / unit, style, label=text)
    ax.plot(x / kPa, y / unit, "ko", markersize=3, label="finite elements")
    ax.set(xlabel="pressure (kPa)", ylabel=label)
axes[0].set_title("fitted")
axes[1].set_title("predicted")
axes[0].legend()
plt.show()

# %% [markdown]
# The fit finds less than 175 kPa: the arc model is too stiff in free space, and the modulus makes up for it. The
# force is then predicted with what is left of the error. From the shell: `softgrip calibrate
# configs/calibrate_shell.toml`, which adds profiles of the likelihood, a verdict on what the data cannot tell, and a
# material file to use in other configs.
