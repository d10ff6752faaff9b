"""Random separations with contact: does every run end, with a status or with finite numbers?

    python tests/benchmarks/contact_fuzz.py [--runs 10000] [--seed 0]

Rings, masses, inertias, restitutions, frictions, stiffnesses, delays, failed springs, mounting errors, rates, late
bolts, pins, rails and walls, gravity on and off, platforms lighter than the satellite; gradients of one run in ten.
"""

import argparse
import collections
import platform
import time
from importlib import metadata

import numpy as np

from satsep_ot.dynamics.contact import Contact, HoldDowns, Rails
from satsep_ot.dynamics.orbit import Orbit
from satsep_ot.dynamics.separation import Body, Separation, Springs, Status
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients
from satsep_ot.dynamics.springs import ForceLaw


def random_separation(rng: np.random.Generator) -> Separation:
    """One separation, from a cube of some kilograms to a satellite that is heavier than its stage."""
    mass = 10.0 ** rng.uniform(0.3, 2.7)
    size = 0.1 * mass ** (1.0 / 3.0)
    inertia = mass * size**2 * rng.uniform(0.2, 0.35, 3)
    stage = mass * 10.0 ** rng.uniform(-0.5, 2.0)
    stage_size = 0.1 * stage ** (1.0 / 3.0) * rng.uniform(1.0, 3.0)
    satellite = Body(mass, inertia, [*(0.05 * size * rng.standard_normal(2)), size * rng.uniform(0.2, 2.0)])
    satellite = Body(mass, inertia, satellite.center_of_mass[[0, 2, 1]])
    body = Body(
        stage, stage * stage_size**2 * rng.uniform(0.2, 0.35, 3),
        [0.02 * stage_size * rng.standard_normal(), -stage_size, 0.02 * stage_size * rng.standard_normal()],
    )  # fmt: skip
    changes = {}
    kind = rng.integers(4)
    ring = size * rng.uniform(0.3, 1.2)
    if kind == 3:
        half, length = 0.5 * size, size * rng.uniform(1.0, 4.0)
        stroke = rng.uniform(0.5, 1.0) * length
        work = 0.5 * mass * rng.uniform(0.3, 2.0) ** 2
        springs = Springs([0.0], 0.1 * half * rng.uniform(), work / (stroke * (1.3 * stroke)), 1.8 * stroke, stroke)
        clearance = rng.choice([1e-4, 2.5e-4, 1e-3, -2e-6])
        law = {"restitution": rng.uniform(0.1, 1.0), "friction": rng.uniform(0.0, 0.5)}
        changes["rails"] = Rails(half, clearance, (0.0, length), length * rng.uniform(0.8, 1.2), **law)
    else:
        count = int(rng.integers(2, 9))
        stroke = rng.uniform(0.005, 0.05)
        work = 0.5 * mass * rng.uniform(0.2, 1.2) ** 2 / count
        delay = rng.choice([0.0, 2e-3, 2e-2]) * rng.uniform(size=count)
        springs = Springs(
            2.0 * np.pi * (np.arange(count) + rng.uniform()) / count, ring, work / (0.8 * stroke**2), 1.3 * stroke,
            stroke, delay=delay, scale=(rng.uniform(size=count) > 0.2).astype(float),
        )  # fmt: skip
        if rng.uniform() < 0.3:
            force = rng.uniform(0.1, 1.5) * work / stroke
            springs = springs.joined(
                Springs(
                    [rng.uniform(0, 6)], ring * rng.uniform(), 10.0 ** rng.uniform(5, 8), 0.0, 0.3 * stroke,
                    scale=force, laws=[ForceLaw.FRICTION],
                )
            )  # fmt: skip
        points = int(rng.choice([0, 3, 12, 24, 48]))
        changes["contact"] = Contact(
            ring * rng.uniform(0.9, 1.3), stiffness=10.0 ** rng.uniform(5, 9), restitution=rng.uniform(0.1, 1.0),
            friction=rng.uniform(0.0, 0.5), points=points, walls=kind == 2,
        )  # fmt: skip
        if kind == 2:
            changes |= {
                "envelope": size * np.array([[a, 0.1, b] for a in (-0.6, 0.6) for b in (-0.6, 0.6)]),
                "recess_radius": size * rng.uniform(0.85, 0.9), "recess_depth": size * rng.uniform(0.3, 1.0),
            }  # fmt: skip
        if rng.uniform() < 0.3:
            bolts = int(rng.integers(1, 4))
            changes["hold_downs"] = HoldDowns(
                rng.uniform(0, 6, bolts), ring, rng.uniform(0, 0.03, bolts), 10.0 ** rng.uniform(6, 8)
            )
    if rng.uniform() < 0.3:
        changes["mounting_error"] = 1e-3 * rng.standard_normal(3)
    if rng.uniform() < 0.3:
        changes["orbit"] = Orbit([6.878e6, 0.0, 0.0], [0.0, 7612.6, 0.0])
        changes["gradient_torque"] = bool(rng.integers(2))
    return Separation(
        body, satellite, springs, rates=np.radians(rng.choice([0.0, 0.5, 5.0])) * rng.standard_normal(3), **changes
    )


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    print(f"$ python tests/benchmarks/contact_fuzz.py --runs {options.runs} --seed {options.seed}")
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("numpy", "numba"))
    print(f"{versions}, Python {platform.python_version()}")
    endings, seconds, steps, wrong = collections.Counter(), [], [], []
    for number in range(options.runs):
        separation = random_separation(rng)
        begin = time.perf_counter()
        outcome = simulate(separation)
        seconds.append(time.perf_counter() - begin)
        status = Status(int(outcome.status[0]))
        endings[status.name] += 1
        steps.append(int(outcome.steps[0]))
        numbers = outcome.base[0] if len(separation.recess_points()) else np.delete(outcome.base[0], 21)
        if status == Status.OK and not np.isfinite(numbers).all():
            wrong.append(number)
        if number % 10 == 0 and status == Status.OK:
            gradients = simulate_with_gradients(separation, quantities=["axial_velocity", "rate_x"])
            if not np.isfinite(gradients.quantity_gradient("rate_x")).all():
                wrong.append(number)
    print(f"{options.runs:,} runs:", ", ".join(f"{name} {count:,}" for name, count in endings.most_common()))
    print(f"steps: median {np.median(steps):.0f}, 99 % {np.quantile(steps, 0.99):.0f}, most {max(steps):,}")
    print(
        f"seconds a run: median {np.median(seconds):.1e}, 99 % {np.quantile(seconds, 0.99):.1e}, "
        f"most {max(seconds):.2g}"
    )
    print(f"runs that are OK with a number, or a gradient, that is not finite: {wrong or 'none'}")


if __name__ == "__main__":
    main()
