"""Each recipe of docs/extending.md is done as the page says it, and the answers are those of closed forms."""

import json
import math

import pytest
from recipes import Recipe

# A law is added to a copy: the push of four such springs on each force line, then of one beside three linear ones.
FADING = """
import json
from dataclasses import replace
import satsep_ot
from satsep_ot.dynamics.separation import Springs
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.dynamics.springs import ForceLaw, ForceLine

separation = satsep_ot.SeparationProblem("reference").getCase().separation
angle, results = separation.springs.angle, {"file": satsep_ot.__file__}


def add(name, **changes):
    outcome = simulate(replace(separation, **changes))
    assert outcome.status[0] == 0, outcome.explain(0)
    results[name] = [outcome.quantity("axial_velocity")[0], outcome.quantity("lateral_rate")[0]]


four = Springs(angle, 0.3, 0.0, 0.0, 0.03, laws=[ForceLaw.FADING] * 4)
for line in ForceLine:
    add(line.name, springs=four, force_line=line, stowed_length=0.04 if line.has_stowed_length else 0.0)
laws = [ForceLaw.LINEAR] * 3 + [ForceLaw.FADING]
for radius in (0.3, 0.0):
    springs = Springs(angle, radius, [5500.0] * 3 + [0.0], [0.04] * 3 + [0.0], 0.03, laws=laws)
    add(str(radius), springs=springs)
print(json.dumps(results))
"""


@pytest.mark.slow
def test_a_force_law(tmp_path):
    recipe = Recipe("A force law", tmp_path)
    (function,), (row,) = recipe.python_blocks(), recipe.rows()
    path = "satsep_ot/dynamics/kernels/force_laws.py"
    recipe.insert(path, function + "\n", before="class Law(")
    recipe.insert(path, f"    {row}\n", before="    function: Callable\n    is_linear: bool\n")
    results = json.loads(recipe.run("-c", FADING))
    assert results.pop("file").startswith(str(tmp_path))
    # The energy says how fast the bodies part: 100 N exp(-s / 20 mm) over 30 mm, and K L (xi - L / 2) each.
    reduced_mass = 1.0 / (1.0 / 1200.0 + 1.0 / 100.0)
    fading, linear = 100.0 * 0.02 * (1.0 - math.exp(-1.5)), 5500.0 * 0.03 * 0.025
    four, mixed = (math.sqrt(2.0 * energy / reduced_mass) for energy in (4.0 * fading, 3.0 * linear + fading))
    assert (four, mixed) == pytest.approx((0.36696, 0.549354), rel=1e-5)
    # Gravity and the rates of the stack have a part in the sixth digit.
    for line in ("GUIDED", "STRUT", "NORMAL"):
        assert results[line][0] == pytest.approx(four, rel=2e-6), line
    assert results["0.0"][0] == pytest.approx(mixed, rel=2e-6)
    # Off the axis a part of the energy turns the bodies; the numbers are those of an independent computation.
    assert results["0.3"] == pytest.approx([0.54388, 13.89], rel=4e-4)
    # The contract of all laws, on each force line.
    assert " passed" in recipe.run("-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/test_force_contract.py")


CONE = """
import json
import numpy as np
from satsep_ot.dynamics.contact import Contact
from satsep_ot.dynamics.separation import Body, Separation, Springs
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients

# A point just below the centre of mass flies into the cone; without friction and damping it is reflected.
heavy = 1e9 * np.ones(3)
separation = Separation(
    Body(1e9, heavy), Body(100.0, heavy, [0.0, 0.1, 0.0]), Springs([0.0], 0.3, 5500.0, 0.04, 0.03, scale=0.0),
    impulse=[20.0, 1.0, 5.0], envelope=[[0.0, 0.1, 0.0], [0.0, 0.099, 0.0]], recess_radius=0.3, recess_depth=0.5,
    contact=Contact(0.3, restitution=1.0, friction=0.0, stiffness=1e7, points=0, walls=True, surface="cone"),
)
names = separation.parameter_names()
k, step = names.index("recess_radius"), 1e-6
fields = ["axial_velocity", "lateral_velocity", "last_contact"]
outcome = simulate_with_gradients(separation, quantities=fields, tolerance=1e-12)
rows = np.tile(separation.parameters(), (2, 1))
rows[:, k] += [step, -step]
around = simulate(separation, rows, tolerance=1e-13)
print(json.dumps([
    outcome.base[0, 3:6].tolist(), outcome.explain(0),
    [outcome.quantity_gradient(name)[0, k] for name in fields],
    [(around.quantity(name)[0] - around.quantity(name)[1]) / (2.0 * step) for name in fields],
]))
"""


@pytest.mark.slow
def test_a_contact_surface(tmp_path):
    recipe = Recipe("A contact surface", tmp_path)
    (function,), (row,) = recipe.python_blocks(), recipe.rows()
    path = "satsep_ot/dynamics/kernels/contact.py"
    recipe.insert(path, function + "\n\n", before="# Curved surfaces of the platform")
    recipe.insert(path, f"    {row}", before='    "cylinder": cylinder,')
    velocity, told, gradient, differences = json.loads(recipe.run("-c", CONE))
    assert told == "the separation completed"
    # v - 2 (v . n) n with the normal where it meets the cone: the direction of the way across the axis.
    v = [20.0 / 100.0, 1.0 / 100.0, 5.0 / 100.0]
    across = math.hypot(v[0], v[2])
    cosine = 1.0 / math.sqrt(1.25)
    n = [-v[0] / across * cosine, 0.5 * cosine, -v[2] / across * cosine]
    along = sum(a * b for a, b in zip(v, n, strict=True))
    assert velocity == pytest.approx([a - 2.0 * along * b for a, b in zip(v, n, strict=True)], rel=2e-2, abs=1e-4)
    assert gradient == pytest.approx(differences, rel=1e-3, abs=1e-4)


TUMBLE = """
import json
import numpy as np
import satsep_ot
from satsep_ot.dynamics.simulation import simulate_with_gradients, trajectory

separation = satsep_ot.SeparationProblem("reference").getCase().separation
nominal = separation.parameters()
i = separation.parameter_names().index("platform.center_of_mass.x")
rows = np.tile(nominal, (3, 1))
rows[:, i] += [0.01, 0.01 + 1e-5, 0.01 - 1e-5]
outcome = simulate_with_gradients(separation, rows, ["stage_tumble"], tolerance=1e-12)
rates = trajectory(separation, [], rows[0], tolerance=1e-12).last_release[6:9]
values = outcome.quantity("stage_tumble")
print(json.dumps([values.tolist(), np.linalg.norm(rates), outcome.quantity_gradient("stage_tumble")[0, i]]))
"""


@pytest.mark.slow
def test_a_quantity_of_interest(tmp_path):
    recipe = Recipe("A quantity of interest", tmp_path)
    row, use = recipe.python_blocks()
    recipe.insert("satsep_ot/dynamics/quantities.py", row)
    (value, above, below), rate, slope = json.loads(recipe.run("-c", TUMBLE))
    assert value == pytest.approx(rate, rel=1e-12)
    assert value > 1e-4
    assert slope == pytest.approx((above - below) / 2e-5, rel=1e-6)
    # The page's own use of it, and the command.
    assert "(3, 35, 1)" in recipe.run("-c", use)
    document = json.loads(recipe.run("-m", "satsep_ot", "simulate", "--json"))
    assert "stage_tumble" in document["quantities"]


GAS = """
import json
import re
import satsep_ot
from satsep_ot.model.case import load_case, parse_case
from satsep_ot.model.schema import case_schema
from satsep_ot.model.separation_function import SeparationFunction

text = re.sub(r"\\[orbit\\].*?(?=# \\[recontact\\])", "", load_case("reference").text, flags=re.DOTALL)
gas = '[impulse]\\ngas_velocity = 0.25\\n[inputs]\\ngas = { quantity = "impulse.gas_velocity", sigma = "1 %" }'
case = parse_case(text.replace("[inputs]", gas))
function = SeparationFunction(case, quantities=["axial_velocity"])
point = [row.reference for row in case.inputs]
print(json.dumps({
    "file": satsep_ot.__file__,
    "input": [case.inputs[0].name, case.inputs[0].unit, point[0]],
    "velocity": function.evaluate([point])[0, 0],
    "slope": function.computeGradientSample([point])[0, 0, 0],
    "schema": case_schema()["properties"]["impulse"]["properties"]["gas_velocity"],
}))
"""


@pytest.mark.slow
def test_a_parameter(tmp_path):
    recipe = Recipe("An uncertain input", tmp_path)
    field, row, physics, adjoint = recipe.rows()
    recipe.insert("satsep_ot/dynamics/separation.py", f"    {field}", before="    recontact: Recontact | None = None")
    table = "satsep_ot/model/parameters.py"
    recipe.insert(table, f"    {row}", before='    Row("momentum", Vector(NEWTON_SECOND)')
    constants = "satsep_ot/dynamics/kernels/constants.py"
    recipe.insert(constants, f"    {physics}", before="    L_1 = minus(cross(arm, Delta_p), Delta_h)")
    recipe.insert(constants, f"    {adjoint}", before="    put(gradient.rates, ")
    results = json.loads(recipe.run("-c", GAS))
    assert results.pop("file").startswith(str(tmp_path))
    assert results["input"] == ["gas", "m/s", 0.25]
    # The energy of the springs and that of the gas add: v^2 = 2 E / mu + v_gas^2.
    reduced_mass = 1.0 / (1.0 / 1200.0 + 1.0 / 100.0)
    velocity = math.sqrt(2.0 * 16.5 / reduced_mass + 0.25**2)
    assert results["velocity"] == pytest.approx(velocity, rel=1e-7)
    assert results["slope"] == pytest.approx(0.25 / velocity, rel=1e-6)
    assert results["schema"]["minimum"] == 0
    assert results["schema"]["description"].endswith("[m/s], not negative.")
    text = (tmp_path / "satsep_ot" / "model" / "cases" / "reference.toml").read_text(encoding="utf-8")
    text = text.replace("[inputs]", "[impulse]\ngas_velocity = 0.25\n[inputs]")
    (tmp_path / "gas.toml").write_text(text, encoding="utf-8")
    assert "Impulse: gas velocity 0.25 m/s" in recipe.run("-m", "satsep_ot", "check", "gas.toml")
    # The contracts of all parameters: their places, their gradients.
    tests = ("tests/test_parameter_vector.py", "tests/test_sensitivities.py", "-k", "not against_central or guided")
    assert " passed" in recipe.run("-m", "pytest", "-q", "-p", "no:cacheprovider", *tests)
