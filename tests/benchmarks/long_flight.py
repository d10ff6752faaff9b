"""How long the motion after the release stays exact under gravity: `trajectory` beside two orbits by scipy.

    python tests/benchmarks/long_flight.py

The reference case, nominal run. From the last release on both bodies fly freely: their orbits by scipy's DOP853 with
tolerance 1e-13, the recoil of the platform included, from the relative state that the run has at its last release.
"""

import numpy as np
import scipy
from scipy.integrate import solve_ivp

import satsep_ot
from satsep_ot.dynamics.simulation import inertial_motion, trajectory
from satsep_ot.model.case import load_case

TIMES = (1.0, 5.0, 10.0, 100.0, 900.0)


def main():
    print(f"satsep-ot {satsep_ot.__version__}, numpy {np.__version__}, scipy {scipy.__version__}; reference case")
    separation = load_case("reference").separation
    run = trajectory(separation, TIMES, tolerance=1e-12)
    release = np.nanmax(run.release_times)
    velocity, distance = (rows[0] for rows in inertial_motion(run.last_release[None]))
    m1, m2 = separation.platform.mass, separation.satellite.mass
    mu = separation.orbit.mu

    def flight(_, state):
        forces = [-mu * r / np.linalg.norm(r) ** 3 for r in (state[0:3], state[3:6])]
        return np.concatenate([state[6:12], *forces])

    # The common centre of mass flies the orbit until the release.
    centre = np.concatenate([separation.orbit.position, separation.orbit.velocity])

    def alone(_, state):
        return np.concatenate([state[3:], -mu * state[:3] / np.linalg.norm(state[:3]) ** 3])

    settings = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-9}
    centre = solve_ivp(alone, (0.0, release), centre, **settings).y[:, -1]
    share = m2 / (m1 + m2)
    start = np.concatenate(
        [centre[:3] - share * distance, centre[:3] + (1.0 - share) * distance,
         centre[3:] - share * velocity, centre[3:] + (1.0 - share) * velocity]
    )  # fmt: skip
    path = solve_ivp(flight, (release, TIMES[-1]), start, t_eval=TIMES, **settings).y
    print("after [s]  distance [m]  error of the distance [m]  error of the velocity [m/s]")
    for k, time in enumerate(TIMES):
        dv, dr = (rows[0] for rows in inertial_motion(run.states[k][None]))
        # Differences of coordinates of 7e6 m are exact to 1e-9 m only.
        error = np.linalg.norm(dr - (path[3:6, k] - path[0:3, k]))
        rate = np.linalg.norm(dv - (path[9:12, k] - path[6:9, k]))
        print(f"{time:9g}  {np.linalg.norm(dr):12.3f}  {error:25.1e}  {rate:27.1e}")


if __name__ == "__main__":
    main()
