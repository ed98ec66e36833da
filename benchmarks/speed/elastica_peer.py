"""PyElastica (MIT licence): a Cosserat rod with the finger's stiffness and the chambers' moment as rest curvature,
relaxed to rest by damped dynamics. Compared with section="inextensible": its sections are linear.
"""

from __future__ import annotations

import numpy as np

DENSITY = 1080.0
"""kg/m^3, thesis section 5.3; at rest it does not matter."""


def relaxed(
    finger: dict[str, float], moment: float, weight: float, tip_load: float, elements: int, seconds: float
) -> tuple[float, float]:
    """(x, y) of the tip, m, of a clamped rod that bends towards -y.

    finger: H, B, L in m and mu in Pa; moment: M_T, N m; weight: g_y, N/m; tip_load: force on the tip along y, N.
    """
    import elastica as ea

    class World(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
        pass

    thick, wide, length, mu = finger["H"], finger["B"], finger["L"], finger["mu"]
    area, stiffness = thick * wide, mu * wide * thick**3 / 3
    world = World()
    x, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    rod = ea.CosseratRod.straight_rod(
        elements,
        np.zeros(3),
        x,
        z,
        length,
        np.sqrt(area / np.pi),
        DENSITY,
        youngs_modulus=3 * mu,
        shear_modulus=mu,
    )
    # d_1 is z, the axis of bending; the moment about it bends towards -y. Shear and stretch are those of a stiff rod.
    rod.bend_matrix[0, 0, :] = stiffness
    rod.rest_kappa[0, :] = -moment / stiffness
    world.append(rod)
    world.constrain(rod).using(ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,))
    if weight:
        world.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=np.array([0.0, weight / (DENSITY * area), 0.0]))
    if tip_load:
        push = np.array([0.0, tip_load, 0.0])
        world.add_forcing_to(rod).using(ea.EndpointForces, 0 * push, push, ramp_up_time=0.1 * seconds)
    step = 0.2 * length / elements * np.sqrt(DENSITY / (3 * mu))
    world.dampen(rod).using(ea.AnalyticalLinearDamper, uniform_damping_constant=20.0, time_step=step)
    world.finalize()
    stepper, time = ea.PositionVerlet(), 0.0
    for _ in range(int(seconds / step)):
        time = stepper.step(world, time, step)
    return float(rod.position_collection[0, -1]), float(rod.position_collection[1, -1])
