"""Writes the synthetic measurements of the sample configs: `python configs/data/make_synthetic.py`.

They are computed with softgrip_jax at known parameters, and noise is added: nothing here was measured. Each file says
so in its first lines, with the parameters that a calibration should find again.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import softgrip_jax as sg
from softgrip_jax.units import degree, kPa, mm

HERE = Path(__file__).resolve().parent


def write(name: str, said: str, header: str, columns: tuple[np.ndarray, ...]) -> None:
    """A CSV file with two comment lines."""
    rows = "\n".join(",".join(f"{v:.6g}" for v in row) for row in zip(*columns, strict=True))
    text = f"# SYNTHETIC, not measured: made by configs/data/make_synthetic.py\n# {said}\n{header}\n{rows}\n"
    (HERE / name).write_text(text, encoding="utf-8")


def shell(mu: float) -> sg.FlatShell:
    """The shell of the thesis with another mu (kPa)."""
    return sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=mu * kPa))


def drive_of_a_finger(finger: sg.PneuNet, rng: np.random.Generator) -> None:
    """Three measurements of one finger that is pushed as the cell law says."""
    strain = np.linspace(0.05, 0.6, 12)
    stress = 136.0 * (1 + strain - (1 + strain) ** -2) + rng.normal(0, 1.0, strain.size)
    said = "uniaxial tension of a neo-Hookean strip, mu = 136 kPa, noise 1 kPa; engineering values"
    write("synthetic_drive_strip.csv", said, "strain_percent,stress_kPa", (100 * strain, stress))
    pressure = np.linspace(5, 25, 9)
    free = sg.pneunet.Free(finger, weight=None, drive="cell")
    angle = np.asarray(sg.path(free, pressure * kPa).tip_angle) / degree + rng.normal(0, 1.0, pressure.size)
    said = "tip angle of a finger of type A on its side, by the cell law, mu = 136 kPa, t_m = 1.1 mm, noise 1 degree"
    write("synthetic_drive_free.csv", said, "pressure_kPa,angle_deg", (pressure, angle))
    held = sg.pneunet.TipContact(finger, weight=None, drive="cell")
    force = np.asarray(sg.path(held, pressure * kPa).tip_force) + rng.normal(0, 0.005, pressure.size)
    said = "tip force of the same finger, its tip held at the height of the clamp, by the cell law, noise 0.005 N"
    write("synthetic_drive_held.csv", said, "pressure_kPa,force_N", (pressure, force))


def shell_that_was_cast(rng: np.random.Generator) -> None:
    """The first inflation of a shell that came out thicker and softer than it was drawn."""
    cast = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.2 * mm, material=sg.NeoHookean(mu=150 * kPa))
    pressure = np.linspace(2, 14, 9)
    inflation = np.asarray(sg.path(sg.shell.Free(cast), pressure * kPa).inflation) / mm
    said = "free inflation of a shell 32 x 86 x 1.2 mm with mu = 150 kPa, noise 0.1 mm"
    noisy = inflation + rng.normal(0, 0.1, inflation.size)
    write("synthetic_cast.csv", said, "pressure_kPa,inflation_mm", (pressure, noisy))


def main() -> None:
    """All files, always the same."""
    rng = np.random.default_rng(20)
    pressure = np.linspace(1, 15, 15)
    for k, mu in enumerate((171.0, 176.0, 180.0), start=1):
        inflation = np.asarray(sg.path(sg.shell.Free(shell(mu)), pressure * kPa).inflation) / mm
        said = f"free inflation of a shell 32 x 86 x 1.1 mm with mu = {mu:g} kPa, noise 0.1 mm"
        noisy = inflation + rng.normal(0, 0.1, inflation.size)
        write(f"synthetic_free_{k}.csv", said, "pressure_kPa,inflation_mm", (pressure, noisy))
    pressure = np.linspace(3, 18, 12)
    force = np.asarray(sg.path(sg.shell.FlatContact(shell(176.0), distance=5.5 * mm), pressure * kPa).force)
    said = "force of the same shell, mu = 176 kPa, on a plane 5.5 mm away, noise 0.15 N"
    noisy = force + rng.normal(0, 0.15, force.size)
    write("synthetic_contact.csv", said, "pressure_mbar,force_N", (10 * pressure, noisy))
    finger = sg.PneuNet.table_5_1("A")
    scene = sg.pneunet.Free(finger, weight=None, inclination="none")
    pressure = np.linspace(5, 34, 16)
    angle = np.asarray(sg.path(scene, pressure * kPa).tip_angle) / degree
    said = "tip angle of a finger of type A without weight, mu = 136 kPa, H = 5 mm, noise 0.5 degree"
    noisy = angle + rng.normal(0, 0.5, angle.size)
    write("synthetic_finger.csv", said, "pressure_kPa,angle_deg", (pressure, noisy))
    drive_of_a_finger(finger, np.random.default_rng(21))
    strain = np.linspace(0.02, 3.0, 60)
    stretch = 1 + strain
    rise = 2 * (60.0 + 2 * 4.0 * (stretch**2 + 2 / stretch - 3) + 3 * 0.05 * (stretch**2 + 2 / stretch - 3) ** 2)
    stress = rise * (stretch - stretch**-2)
    said = "uniaxial tension of a Yeoh material, C1 = 60, C2 = 4, C3 = 0.05 kPa, noise 3 kPa; engineering values"
    noisy = (stress + rng.normal(0, 3, stress.size)) / 1000
    write("synthetic_tension.csv", said, "strain_percent,stress_MPa", (100 * strain, noisy))
    shell_that_was_cast(rng)


if __name__ == "__main__":
    main()
