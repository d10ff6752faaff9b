"""The parts of a small case, which tests put together: two springs, a platform of 10 kg, a satellite of 1 kg."""

# The springs lack their force: LINEAR, or a table, goes on here.
BODIES = """[platform]
mass = 10
inertia = [1, 1, 1]
center_of_mass = [0, -100, 0]
[satellite]
mass = 1
inertia = [0.01, 0.01, 0.01]
center_of_mass = [0, 100, 0]
[springs]
count = 2
radius = 100
stroke = 10
"""
LINEAR = "stiffness = 100\ndeformation = 20\n"
SMALL = BODIES + LINEAR
MASS_AND_RATE = """[inputs]
mass = { quantity = "satellite.mass", sigma = 0.03 }
rate_y = { quantity = "initial.rates.y", sigma = 0.4 }
"""
ROLLING = """[[requirements]]
name = "rolling"
quantity = "spin"
maximum = 1.0
"""
# Of requirements and inputs, each of which something would take for more than a text.
ODD_NAMES = (
    r"$\undefined$", r"a_b%c&d\e", "$5", "{x}", "[/bold] :rocket:", "<b>&amp;", "\N{ROCKET}\N{ZERO WIDTH JOINER}x",
    "שלום", "مرحبا", "宇宙", "é" * 50,
)  # fmt: skip
