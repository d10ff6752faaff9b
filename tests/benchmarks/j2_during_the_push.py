"""What J2 does during the push, beside what it does during the coast: why it acts in the coast only.

python tests/benchmarks/j2_during_the_push.py
"""

from dataclasses import replace

import numpy as np

import satsep_ot
from satsep_ot.dynamics.gravity import EARTH_RADIUS
from satsep_ot.dynamics.kernels.coast import oblateness_difference
from satsep_ot.dynamics.orbit import EARTH_J2, Orbit
from satsep_ot.dynamics.relative_orbit import Recontact, closest_approaches
from satsep_ot.dynamics.rotations import rotation_matrix
from satsep_ot.dynamics.simulation import trajectory
from satsep_ot.model.case import load_case


def main():
    separation = load_case("reference").separation
    end = trajectory(separation, []).release_times.max()
    times = np.linspace(0.0, end, 201)
    path = trajectory(separation, times)
    distances = [rotation_matrix(state[16:20]) @ state[:3] for state in path.states]
    orbits = [
        Orbit.from_elements(np.linalg.norm(separation.orbit.position), 0.0, inclination, 0.0, 0.0, latitude)
        for inclination in np.radians([0.0, 30.0, 63.4, 97.4])
        for latitude in np.radians(np.arange(0.0, 360.0, 15.0))
    ]
    accelerations, velocities = [], []
    for orbit in orbits:
        ob = 1.5 * EARTH_J2 * orbit.mu * EARTH_RADIUS**2
        # The stack is fixed in inertial axes during the push, so every direction of d is met as the orbit turns.
        course = np.array([oblateness_difference(ob, orbit.position, d) for d in distances])
        accelerations.append(np.linalg.norm(course, axis=1).max())
        velocities.append(np.linalg.norm(np.trapezoid(course, times, axis=0)))
    print(f"satsep-ot {satsep_ot.__version__}, numpy {np.__version__}; reference case, push of {1e3 * end:.1f} ms")
    print(f"{len(orbits)} places on circular orbits of 500 km, inclinations 0 to 97.4 deg; largest of all:")
    print(f"  J2, difference of the accelerations of the two CGs  {max(accelerations):.1e} m/s2")
    print(f"  J2, change of the relative velocity at the release  {max(velocities):.1e} m/s")
    print(f"  the same over the separation velocity               {max(velocities) / path.last_release[4]:.1e}")
    masses = [[separation.platform.mass, separation.satellite.mass]]
    changes = []
    for orbit in orbits:
        with_j2, without = (
            closest_approaches([path.last_release], [end], masses, replace(orbit, j2=j2), Recontact())[0][0]
            for j2 in (True, False)
        )
        changes.append(abs(with_j2 - without))
    print(f"  J2, change of the smallest distance of the coast    {max(changes):.1e} m")


if __name__ == "__main__":
    main()
