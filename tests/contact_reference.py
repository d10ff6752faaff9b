"""Contact solved once more, from its laws alone: Newton and Euler in inertial axes, rotation matrices, scipy's DOP853.

Nothing of the package is used. Contacts have no modes here: the law is evaluated as it stands, and the integrator steps
over its kinks with small steps. Only releases of springs and bolts are events.
"""

import numpy as np
from scipy.integrate import solve_ivp

LONGEST_STEP = 2e-4  # s, so that no touch passes unseen


def start(case):
    """The state at t = 0: D, V, R_1, R_2, omega_1, omega_2 (inertial axes), r_1, v_1."""
    c_1, c_2 = (np.array(case[body]["cg"], dtype=float) for body in ("platform", "satellite"))
    Omega = np.array(case["omega0"], dtype=float)
    r, v = (np.array(case["gravity"][key]) if case["gravity"] else np.zeros(3) for key in ("r_eci", "v_eci"))
    D = c_2 - c_1
    return np.concatenate([D, np.cross(Omega, D), np.eye(3).ravel(), np.eye(3).ravel(), Omega, Omega, r, v])


def law(given, gap, rate, v_t):
    """Normal force and friction of contacts, (M,) and (M, 3)."""
    bracket = 1.0 - given["damping"] * rate
    N = np.where((gap < 0.0) & (bracket > 0.0), -given["k"] * gap * bracket, 0.0)
    return N, -given["mu"] * (N / np.sqrt((v_t**2).sum(axis=1) + given["v_eps"] ** 2))[:, None] * v_t


class Reference:
    """The right-hand side of a case, and what acts of springs and bolts."""

    def __init__(self, case):
        self.case = case
        self.c_1, self.c_2 = (np.array(case[body]["cg"], dtype=float) for body in ("platform", "satellite"))
        self.m_1, self.m_2 = (case[body]["mass"] for body in ("platform", "satellite"))
        self.J_1, self.J_2 = (
            np.diag(J) if J.ndim == 1 else J
            for J in (np.array(case[body]["inertia"], dtype=float) for body in ("platform", "satellite"))
        )
        springs = case["springs"]
        radius, alpha = np.broadcast_to(springs["R"], len(springs["K"])), np.array(springs["alpha"])
        self.seats = np.stack([radius * np.cos(alpha), 0.0 * alpha, radius * np.sin(alpha)], axis=1)
        self.K, self.xi = np.array(springs["K"], dtype=float), np.array(springs["xi"], dtype=float)
        self.L = np.minimum(springs["L"], self.xi)
        self.pushing = np.ones(len(self.K), bool)
        self.pushing[springs["failed"]] = False
        self.held = np.ones(len(case["hold_down"]), bool)
        deck, rails = case["contact"].get("deck"), case["contact"].get("rails")
        if deck:
            angles = deck["angle0"] + 2.0 * np.pi * np.arange(deck["points"]) / deck["points"]
            self.feet = deck["radius"] * np.stack([np.cos(angles), 0.0 * angles, np.sin(angles)], axis=1)
        if rails:
            w, outer = rails["half_width"], rails["half_width"] + rails["clearance"]
            corners = [(x, z) for x in (1, -1) for z in (1, -1)]
            self.ends = np.array([[x * w, y, z * w] for y in rails["satellite_y"] for x, z in corners])
            self.mouths = np.array([[x * outer, rails["mouth_y"], z * outer] for x, z in corners])

    def strokes(self, y):
        D, R_1, R_2 = y[:3], y[6:15].reshape(3, 3), y[15:24].reshape(3, 3)
        return (D + (self.seats - self.c_2) @ R_2.T) @ R_1[:, 1] + self.c_1[1]

    def __call__(self, t, y):
        D, V = y[:3], y[3:6]
        R_1, R_2 = y[6:15].reshape(3, 3), y[15:24].reshape(3, 3)
        w_1, w_2, r_1, v_1 = y[24:27], y[27:30], y[30:33], y[33:36]
        forces, places = [np.zeros((0, 3))], [np.zeros((0, 3))]  # on the satellite; from the platform's CG

        def satellite_points(b):
            arms = (b - self.c_2) @ R_2.T
            P = D + arms
            return P, V + np.cross(w_2, arms) - np.cross(w_1, P)

        P, _ = satellite_points(self.seats)
        on = self.pushing & (t >= self.delays)
        forces.append(np.where(on, self.K * (self.xi - P @ R_1[:, 1] - self.c_1[1]), 0.0)[:, None] * R_1[:, 1])
        places.append(P)
        if "deck" in self.case["contact"]:
            P, v = satellite_points(self.feet)
            rate = v @ R_1[:, 1]
            N, F = law(self.case["contact"]["deck"], P @ R_1[:, 1] + self.c_1[1], rate, v - rate[:, None] * R_1[:, 1])
            forces.append(F + N[:, None] * R_1[:, 1])
            places.append(P)
        if "rails" in self.case["contact"]:
            self.add_rails(D, V, R_1, R_2, w_1, w_2, satellite_points, forces, places)
        for bolt, held in zip(self.case["hold_down"], self.held, strict=True):
            if held:
                P, v = satellite_points(np.array([bolt["point"]], dtype=float))
                extension = P - R_1 @ (np.array(bolt["point"]) - self.c_1)
                forces.append(-bolt["k"] * (extension + bolt["T"] * v))
                places.append(P)
        F, P = np.concatenate(forces), np.concatenate(places)
        total = F.sum(axis=0)
        M_2, M_1 = np.cross(P - D, F).sum(axis=0), -np.cross(P, F).sum(axis=0)
        acceleration, a_1 = total * (1.0 / self.m_1 + 1.0 / self.m_2), np.zeros(3)
        if self.case["gravity"]:
            mu, r_2 = self.case["gravity"]["mu"], r_1 + D
            a_1 = -mu * r_1 / np.linalg.norm(r_1) ** 3
            acceleration = acceleration - mu * r_2 / np.linalg.norm(r_2) ** 3 - a_1
        slopes = [V, acceleration]
        for w, R in ((w_1, R_1), (w_2, R_2)):
            slopes.append(np.cross(w, R, axisb=0).T.ravel())
        for w, R, J, M in ((w_1, R_1, self.J_1, M_1), (w_2, R_2, self.J_2, M_2)):
            body = R.T @ w
            slopes.append(R @ np.linalg.solve(J, R.T @ M - np.cross(body, J @ body)))
        return np.concatenate([*slopes, v_1, a_1])

    def add_rails(self, D, V, R_1, R_2, w_1, w_2, satellite_points, forces, places):
        rails = self.case["contact"]["rails"]
        w, outer = rails["half_width"], rails["half_width"] + rails["clearance"]
        P, v = satellite_points(self.ends)
        inside = P @ R_1[:, 1] + self.c_1[1] < rails["mouth_y"]
        for axis in (0, 2):
            side = np.sign(self.ends[:, axis])
            gap = outer - side * (P @ R_1[:, axis] + self.c_1[axis])
            nu = -side[:, None] * R_1[:, axis]
            rate = (nu * v).sum(axis=1)
            N, F = law(rails, np.where(inside, gap, 1.0), rate, v - rate[:, None] * nu)
            forces.append(F + N[:, None] * nu)
            places.append(P)
        P = (self.mouths - self.c_1) @ R_1.T
        arms = P - D
        v = V + np.cross(w_2, arms) - np.cross(w_1, P)
        q = arms @ R_2 + self.c_2
        low, high = rails["satellite_y"]
        inside = (q[:, 1] > low) & (q[:, 1] < high)
        for axis in (0, 2):
            side = np.sign(self.mouths[:, axis])
            gap = side * q[:, axis] - w
            nu = -side[:, None] * R_2[:, axis]
            rate = (nu * v).sum(axis=1)
            N, F = law(rails, np.where(inside, gap, 1.0), rate, v - rate[:, None] * nu)
            forces.append(F + N[:, None] * nu)
            places.append(P)


def solve(case, end, rtol=1e-11):
    """Velocity of the CGs in platform axes and rates of the satellite in its axes at `end`; release times."""
    run = Reference(case)
    run.delays = np.broadcast_to(case["springs"].get("delay", 0.0), len(run.K))
    y, t = start(case), 0.0
    releases = np.full(len(run.K), np.nan)
    times = sorted({end, *(bolt["release"] for bolt in case["hold_down"]), *(float(d) for d in run.delays if d > 0.0)})
    atol = np.full(36, 1e-13)
    atol[30:33] = 1e-3

    def event(i):
        def gap(t, y):
            return run.L[i] - run.strokes(y)[i]

        gap.terminal, gap.direction = True, -1.0
        return gap

    while t < end:
        stop = next(time for time in times if time > t)
        pushing = np.flatnonzero(run.pushing & (run.delays <= t))
        path = solve_ivp(
            run, (t, stop), y, "DOP853", rtol=rtol, atol=atol, max_step=LONGEST_STEP,
            events=[event(i) for i in pushing] or None,
        )  # fmt: skip
        t, y = path.t[-1], path.y[:, -1]
        if path.status == 1:
            strokes = run.strokes(y)
            for i in pushing:
                if strokes[i] > run.L[i] - 1e-11:
                    run.pushing[i], releases[i] = False, t
        for k, bolt in enumerate(case["hold_down"]):
            run.held[k] = bolt["release"] > t
    R_1, R_2 = y[6:15].reshape(3, 3), y[15:24].reshape(3, 3)
    return R_1.T @ y[3:6], R_2.T @ y[27:30], releases


def fresh_case(random, kind):
    """A case that no list holds, in the format of the truth set."""
    n = int(random.integers(3, 7))
    radius = random.uniform(0.25, 0.6)
    mass = random.uniform(30.0, 300.0)
    size = radius * random.uniform(0.8, 1.2)
    satellite = {
        "mass": mass, "inertia": (mass * size**2 * random.uniform(0.25, 0.4, 3)).tolist(),
        "cg": [random.uniform(-0.005, 0.005), random.uniform(0.05, 0.2), random.uniform(-0.005, 0.005)],
    }  # fmt: skip
    heavier = random.uniform(0.4, 0.8) if random.random() < 0.4 else random.uniform(5.0, 20.0)
    # A platform may be the lighter one.
    platform = {
        "mass": heavier * mass, "inertia": (heavier * mass * random.uniform(0.5, 0.8, 3)).tolist(),
        "cg": [0.01, -random.uniform(0.4, 1.2), -0.01],
    }  # fmt: skip
    push = 55.0 * mass / n
    springs = {
        "alpha": (2.0 * np.pi * (np.arange(n) + random.random()) / n).tolist(), "R": radius, "K": [push] * n,
        "xi": [0.04] * n, "L": [0.03] * n, "failed": [0] if n < 4 else [0, 1],
    }  # fmt: skip
    law = {"damping": 1.0 / random.uniform(0.003, 0.03), "mu": random.uniform(0.0, 0.3), "v_eps": 1e-3}
    case = {
        "platform": platform, "satellite": satellite, "springs": springs, "attitude0": [1.0, 0.0, 0.0, 0.0],
        "omega0": random.normal(0.0, 0.01, 3).tolist(), "velocity0": [0.0, 0.0, 0.0], "gravity": None,
        "hold_down": [], "contact": {},
    }  # fmt: skip
    if random.random() < 0.5:
        case["gravity"] = {
            "r_eci": [6.9e6, 1e5, -2e5], "v_eci": [100.0, 5000.0, 5600.0], "mu": 3.986004418e14, "gradient": False
        }  # fmt: skip
    points = {
        "radius": radius * random.uniform(1.0, 1.1),
        "points": int(random.integers(12, 40)),
        "angle0": random.random(),
    }
    if kind in ("deck", "bolt"):
        case["contact"]["deck"] = {"k": 10.0 ** random.uniform(6.0, 7.0), **law, **points}
    if kind == "bolt":
        springs["failed"] = []
        angle = random.uniform(0.0, 2.0 * np.pi)
        case["hold_down"] = [{
            "point": [radius * np.cos(angle), 0.0, radius * np.sin(angle)], "release": random.uniform(2e-3, 15e-3),
            "k": 1e7, "T": 2e-4,
        }]  # fmt: skip
    if kind == "rails":
        w, length = random.uniform(0.05, 0.12), random.uniform(0.3, 0.4)
        mass = random.uniform(4.0, 20.0)
        across, along = mass * (length**2 + 4.0 * w * w) / 12.0, mass * w * w * 2.0 / 3.0
        case["satellite"] = {"mass": mass, "cg": [0.003, 0.5 * length, -0.002], "inertia": [across, along, across]}
        case["springs"] = {
            "alpha": [1.0], "R": 0.003, "K": [6.0 * mass], "xi": [0.6], "L": [length], "failed": [], "delay": 0.0
        }  # fmt: skip
        case["contact"]["rails"] = {
            "half_width": w, "clearance": 2e-4, "satellite_y": [0.0, length], "mouth_y": length + 0.01,
            "k": 1e5, **law,
        }  # fmt: skip
    return case
