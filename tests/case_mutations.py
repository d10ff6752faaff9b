"""Random damage to case files, for tests: to their data, written as TOML again, and to their text."""

import json
import math
import re

import openturns as ot

TOUCHING = """
[contact]
[[hold_down]]
angle = 10.0
radius = 300.0
release = 2.0
[rails]
half_width = 50.0
clearance = 0.2
satellite = [0.0, 300.0]
mouth = 320.0
"""
# What the cases of the package leave out.
EVERY_TABLE = """
horizon = 20.0
platform = { mass = 1200.0, inertia = [1500.0, 600.0, 1500.0], center_of_mass = [0.0, -1600.0, 0.0] }
[satellite]
mass = 100.0
inertia = [[9.35, 0.1, 0.0], [0.1, 8.0, 0.0], [0.0, 0.0, 9.35]]
center_of_mass = [0.0, 400.0, 0.0]
[springs]
angles = [45.0, 135.0, 225.0, 315.0]
radius = 300.0
stiffness = [5500.0, 0.0, 5400.0, 5500.0]
deformation = 40.0
stroke = 30.0
cant = 0.1
delay = 1.0
scale = [1.0, 1.01, 1.0, 1.0]
table = { 2 = [[0.0, 220.0], [10.0, 170.0], [31.0, 55.0]] }
force_line = "normal"
guide_friction = 0.1
[umbilical]
angle = 30.0
radius = 250.0
stiffness = 2000.0
deformation = 8.0
stroke = 6.0
friction = 15.0
engagement = 5.0
[impulse]
momentum = [0.1, 0.2, 0.3]
angular_momentum = [0.01, 0.02, 0.03]
[initial]
attitude = [10.0, 20.0, 30.0]
rates = [0.1, 0.2, 0.3]
velocity = [0.1, 0.2, 0.3]
mounting_error = [0.0, 0.01, 0.0]
pivot = "platform"
[orbit]
perigee_altitude = 500.0
apogee_altitude = 600.0
inclination = 97.0
right_ascension = 10.0
argument_of_perigee = 20.0
true_anomaly = 30.0
gravitational_parameter = 398600.4418
gradient_torque = true
j2 = true
[recontact]
start_orbits = 0.1
end_orbits = 0.2
[envelope]
points = [[350.0, 0.0, 350.0], [300.0, 100.0, 300.0]]
recess_radius = 520.0
recess_depth = 250.0
planes = [{ normal = [-1.0, 0.0, 0.0], offset = -400.0 }]
[inputs]
momentum = { quantity = "impulse.momentum.y", sigma = 0.1 }
radius = { quantity = "springs.radius.each", plus_minus = 0.5, description = "radius" }
connector = { quantity = "umbilical.friction", distribution = "Uniform", a = 10.0, b = 20.0 }
wall = { quantity = "envelope.planes.1.offset", three_sigma = 1.0, mean = -401.0 }
guide = { quantity = "springs.guide_friction", sigma = "5 %" }
stroke = { quantity = "springs.stroke.2", plus_minus = 0.9 }
[[correlation]]
inputs = ["momentum", "radius"]
coefficient = 0.1
[[correlation]]
inputs = ["wall", "guide"]
rank = -0.2
[[requirements]]
quantity = "recontact_distance"
minimum = 10.0
"""
DISTRIBUTIONS = sorted(
    name
    for name, value in vars(ot).items()
    if isinstance(value, type) and issubclass(value, ot.DistributionImplementation)
)
# What may stand where something else stood. Numbers beyond sense, at the edges of what is allowed, and of all sizes.
NUMBERS = (
    0, 1, -1, 2, 3, 7, 1000, 10**30, -(10**40), 10**400, 2**63, 0.0, -0.0, 1.0, -1.0, 0.5, 90.0, 89.999, 1e-5, 1e-30,
    5e-324, 1e9, 9.9e29, 1e30, 1e154, 1e300, -1e300, 1.7976931348623157e308, math.inf, -math.inf, math.nan,
)  # fmt: skip
TEXTS = (
    "", " ", "nan", "inf", "1.0", "1 %", "-1 %", "1e400 %", "nan %", "inf %", "%", "100000 %", "0 %", "strut", "normal",
    "guided", "stack", "platform", "up", "along-track", "normal.csv", "nothing.csv", ".", "..", "/", "/dev/null",
    "/dev/zero", "a\0b", "a\nb", "\u202e\u0000", "Ω" * 40, "𝟙", "💥", "x" * 5000, "any requirement", "reference",
    "__import__('os').system('true')", "${HOME}", "../../../../etc/passwd", "mass\u0301", "\ufeff",
)  # fmt: skip


def written(data):
    """Tables, lists and values as TOML: the tables at the top under their headings, what is in them on one line."""
    lines = [f"{key_text(key)} = {value_text(value)}" for key, value in data.items() if not isinstance(value, dict)]
    for key, table in data.items():
        if isinstance(table, dict):
            lines.append(f"[{key_text(key)}]")
            lines += [f"{key_text(inner)} = {value_text(value)}" for inner, value in table.items()]
    return "\n".join(lines) + "\n"


def key_text(key):
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else value_text(key)


def value_text(value):
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list):
        return "[" + ", ".join(map(value_text, value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key_text(key)} = {value_text(inner)}" for key, inner in value.items()) + "}"
    return repr(value) if isinstance(value, (int, float)) else str(value)


def places(data):
    """Every (container, key) of the data, at any depth."""
    found = []
    for key, value in list(data.items()) if isinstance(data, dict) else list(enumerate(data)):
        found.append((data, key))
        if isinstance(value, (dict, list)):
            found += places(value)
    return found


def damage_data(data, random):
    """Change one thing in the data, in place; `random` is a `random.Random`."""
    if not places(data):
        return
    container, key = random.choice(places(data))
    other_container, other_key = random.choice(places(data))
    value = container[key]
    kind = random.randrange(14)
    if kind == 0:
        del container[key]
    elif kind == 1:
        container[key] = random.choice(NUMBERS)
    elif kind == 2:
        container[key] = random.choice(TEXTS)
    elif kind == 3:
        container[key] = random.choice([True, False, [], {}, [[]], [{}], {"": {}}, [1.0, "1.0"]])
    elif kind == 4 and not inside(container, other_container):
        # Two things swapped, be they numbers or whole tables.
        container[key], other_container[other_key] = other_container[other_key], value
    elif kind == 5 and isinstance(container, dict):
        container[misspelt(key, random)] = container.pop(key)
    elif kind == 6:
        container[key] = [value]
    elif kind == 7:
        container[key] = {str(other_key): value}
    elif kind == 8 and isinstance(value, list):
        value += [random.choice(value) if value else random.choice(NUMBERS)] * random.choice([1, 1, 2, 50])
    elif kind == 9 and isinstance(value, list) and value:
        del value[random.randrange(len(value)) :]
    elif kind == 10 and isinstance(container, dict):
        container[random.choice([str(other_key), *TEXTS[:6], "sigma", "distribution"])] = random.choice(NUMBERS)
    elif kind == 11:
        container[key] = random_distribution(random, value)
    elif (isinstance(value, int) and not isinstance(value, bool)) or (
        isinstance(value, float) and math.isfinite(value)
    ):
        # Of another size or sign, often still allowed: what follows must then cope.
        scale = random.choice([-1.0, 0.5, 2.0, 1e-3, 1e3, 1e-6, 1e6, 10.0 ** random.uniform(-20.0, 20.0)])
        container[key] = float(min(max(value, -1e200), 1e200)) * scale + random.choice([0.0, 0.0, 1e-3, 1.0])
    elif isinstance(value, str):
        # The word of another place: a quantity, a choice.
        words = [inner[place] for inner, place in places(data) if isinstance(inner[place], str)]
        container[key] = random.choice(words)


def inside(container, other):
    """Whether one holds the other, so that swapping would make a circle."""
    return (
        any(
            isinstance(outer, (dict, list)) and any(place[0] is inner for place in places(outer))
            for outer, inner in ((container, other), (other, container))
        )
        or container is not other
    )


def misspelt(key, random):
    if len(key) < 2:
        return key + key
    i = random.randrange(len(key) - 1)
    return random.choice([key[:i] + key[i + 1 :], key[:i] + key[i + 1] + key[i] + key[i + 2 :], key.upper(), key + "s"])


def random_distribution(random, entry):
    """An entry of [inputs] with any distribution of OpenTURNS, and any numbers as its parameters."""
    name = random.choice(DISTRIBUTIONS)
    quantity = entry.get("quantity", "satellite.mass") if isinstance(entry, dict) else "satellite.mass"
    try:
        keys = [key.removesuffix("_0") for key in getattr(ot, name)().getParameterDescription()]
    except Exception:
        # OpenTURNS has distributions that cannot be made without arguments.
        keys = ["a", "b"]
    numbers = [random.choice(NUMBERS) if random.random() < 0.3 else 10.0 ** random.uniform(-3.0, 3.0) for _ in keys]
    return {"quantity": quantity, "distribution": name} | dict(zip(keys, sorted(numbers), strict=True))


def damage_text(text, random):
    """The text of a file with one stretch of it lost, doubled, moved or replaced."""
    kind = random.randrange(6)
    i = random.randrange(len(text) + 1)
    j = min(len(text), i + random.choice([1, 1, 3, 20, 200]))
    lines = text.splitlines(keepends=True) or [""]
    a, b = random.randrange(len(lines)), random.randrange(len(lines))
    if kind == 0:
        return text[:i]
    if kind == 1:
        return text[:i] + text[j:]
    if kind == 2:
        return text[:j] + text[i:]
    if kind == 3:
        strange = [*'"[]{}=,#.\n\r\t\\', "\0", "\x1b", "\x7f", "é", "\u2028", "\ufeff", "💥", "'''", '"""', "[[", "nan"]
        return text[:i] + random.choice(strange) + text[i:]
    if kind == 4:
        lines[a], lines[b] = lines[b], lines[a]
    else:
        lines.insert(b, lines[a])
    return "".join(lines)
