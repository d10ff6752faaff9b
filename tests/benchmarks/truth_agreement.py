"""Print how far simulations and their derivatives are from the 128-bit reference solutions (a few seconds).

PYTHONPATH=tests python tests/benchmarks/truth_agreement.py
"""

import platform

import numpy as np
from separation_cases import TRUTH, TRUTH_CASES, truth_parameters, truth_separation

import satsep_ot
from satsep_ot.dynamics.rotations import quaternion_product
from satsep_ot.dynamics.simulation import inertial_motion, simulate_with_gradients, trajectory

# Norms below these are compared as if they were these: rates of 1e-9 rad/s have no digits to agree in.
RATE_FLOOR = 1e-3


def relative_error(value, truth, floor=1e-300):
    """Norm of the difference over the norm of the truth."""
    value, truth = np.asarray(value, dtype=float), np.asarray(truth, dtype=float)
    return np.linalg.norm(value - truth) / max(np.linalg.norm(truth), floor)


def quaternion_error(value, truth):
    """Norm of the difference of two rotations' quaternions."""
    return min(np.linalg.norm(value - np.asarray(truth)), np.linalg.norm(value + np.asarray(truth)))


def state_errors(state, truth):
    """Worst relative error of velocity, position, rates and attitude."""
    velocity, position = inertial_motion(state[None])
    return np.array(
        [
            max(
                relative_error(state[3:6], truth["dv_platform"]),
                relative_error(velocity[0], truth["dv_inertial"]),
                relative_error(position[0], truth["dr_inertial"]),
            ),
            max(
                relative_error(state[6:9], truth["w_plat"], RATE_FLOOR),
                relative_error(state[9:12], truth["w_sat"], RATE_FLOOR),
            ),
            max(
                quaternion_error(state[16:20], truth["q_plat"]),
                quaternion_error(quaternion_product(state[16:20], state[12:16]), truth["q_sat"]),
            ),
        ]
    )


def print_states(tolerance):
    """One line a case and force line, and the worst of all."""
    print(f"\nRelative error at tolerance {tolerance:g}, worst of the last release and of t = {TRUTH['t_end']} s")
    print(f"{'case':22}{'force line':12}{'motion':>10}{'rates':>10}{'attitude':>10}{'releases':>10}")
    worst = np.zeros(4)
    for case in TRUTH_CASES:
        for force_line in ("guided", "strut"):
            truth = TRUTH_CASES[case]["results"][force_line]
            path = trajectory(truth_separation(case, force_line), [TRUTH["t_end"]], tolerance=tolerance)
            errors = np.append(
                np.maximum(
                    state_errors(path.last_release, truth["at_last_release"]),
                    state_errors(path.states[0], truth["at_t_end"]),
                ),
                np.abs(path.release_times / truth["t_release"] - 1.0).max(),
            )
            worst = np.maximum(worst, errors)
            print(f"{case:22}{force_line:12}" + "".join(f"{error:10.1e}" for error in errors))
    print(f"{'worst':34}" + "".join(f"{error:10.1e}" for error in worst))


def print_gradients(tolerance):
    """The worst relative error of the derivatives with respect to each kind of input."""
    print(f"\nRelative error of the derivatives at tolerance {tolerance:g}")
    print(f"{'case':22}{'force line':12}{'velocity':>10}{'rates':>10}{'release':>10}")
    for reference in TRUTH["gradients"]:
        separation = truth_separation(reference["case"], reference["force_line"])
        outcome = simulate_with_gradients(separation, tolerance=tolerance)
        names = separation.parameter_names()
        last = 6 + int(np.argmax(outcome.release_times[0]))
        worst = np.zeros(3)
        for name, truth in reference["derivatives"].items():
            columns = [names.index(parameter) for parameter in truth_parameters(name, len(separation.springs))]
            gradient = outcome.gradients[0][:, columns].sum(axis=1)
            errors = [
                relative_error(gradient[3:6], truth[:3]),
                relative_error(gradient[9:12], truth[3:6]),
                relative_error(gradient[20:21], truth[last : last + 1]),
            ]
            worst = np.maximum(worst, errors)
        print(f"{reference['case']:22}{reference['force_line']:12}" + "".join(f"{error:10.1e}" for error in worst))


if __name__ == "__main__":
    print("PYTHONPATH=tests python tests/benchmarks/truth_agreement.py")
    print(f"satsep-ot {satsep_ot.__version__}, numpy {np.__version__}, Python {platform.python_version()}")
    for level in (1e-8, 1e-12):
        print_states(level)
    for level in (1e-8, 1e-11):
        print_gradients(level)
