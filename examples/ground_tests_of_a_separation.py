"""
Ground tests of a separation
============================

Five drop tests of the flight satellite, without gravity and with another platform, and a dozen springs of the batch on
a test bench: what do they do to the probability in flight? Here the truth is known, because the campaign is made up:
the springs are a little soft, their guides are canted to one side, and the satellite's centre of mass is off. The
update does not know that, and finds it.
"""

import numpy as np
import openturns as ot
import openturns.viewer as otv

from satsep_ot.model.case import new_case_text, parse_case
from satsep_ot.model.ground_tests import SeparationModel, parse_ground_tests
from satsep_ot.studies.separation_update import SeparationUpdate

ot.RandomGenerator.SetSeed(0)

# The reference case already says that tests and flight have the same satellite. Two means are known only roughly: of
# the stiffness of this batch of springs, and of the cant of their guides.
text = new_case_text("reference", "campaign")
for entry, uncertainty in (("stiffness", '"0.5 %"'), ("cant", "0.1")):
    start = f'{entry} = {{ quantity = "springs.{entry}.each",'
    text = text.replace(start, f"{start} mean_uncertainty = {uncertainty},")
case = parse_case(text)

# %%
# The campaign. The platform of the tests is lighter than the stage; there is no gravity. Values are made up by the
# simulator from a truth that lies within what the case allows.
HEADER = "test,quantity,value,sigma,orbit,platform.mass"
ERRORS = {"axial_velocity": 0.0005, "rate_x": 0.02, "rate_y": 0.02, "rate_z": 0.02}
OFF = {"satellite_cg_x": 2.0, "satellite_cg_z": -1.0, "satellite_mass": 0.4}
STIFFNESS, CANT = 5465.0, 0.12


def drawn():
    """The inputs of one separation of the truth."""
    values = []
    for row in case.inputs:
        value = row.distribution.getRealization()[0]
        if row.is_shared_by_tests:
            value = row.reference + OFF.get(row.name, 0.0)
        value += {"stiffness": STIFFNESS - 5500.0, "cant": CANT}.get(row.entry, 0.0)
        values.append(value)
    return values


quantities = list(ERRORS)
conditions = parse_ground_tests(f"{HEADER}\nt,rate_x,0,1,none,800", case)[0].separation
bench = SeparationModel(case.inputs, conditions, quantities)
rows = [HEADER]
for number in range(1, 6):
    measured = bench.evaluate([drawn()])[0]
    for (name, error), value in zip(ERRORS.items(), measured, strict=True):
        noisy = ot.Normal(value, error).getRealization()[0]
        rows.append(f"drop {number},{name},{noisy:.5f},{error},none,800")
for number in range(1, 13):
    stiffness = ot.Normal(STIFFNESS, 55.0).getRealization()[0]
    rows.append(f"spring {number},stiffness,{stiffness:.0f},5,,")
table = "\n".join(rows)
print(table)

# %%
# The update: what the tests teach, beside the truth.
update = SeparationUpdate(case, parse_ground_tests(table, case), size=300)
update.run()
result = update.getResult()
print(result.headline)
truth = {row.name: row.reference + OFF.get(row.name, 0.0) for row in case.inputs}
truth |= {"stiffness": STIFFNESS, "cant": CANT}
for row in result.learnt:
    print(
        f"{row.name:15} {row.kind:5} before {row.before:8.2f} +- {row.before_sigma:<6.2g}"
        f" after {row.after:8.2f} +- {row.after_sigma:<6.2g} truth {truth[row.name]:8.2f} {row.unit}"
    )

# %%
# The probability of each violation: its mean, and the bound below which it is with a credibility of 95 %. The truth's
# probability is counted among 20,000 runs.
flight = SeparationModel(case.inputs, case.separation, [entry.quantity for entry in case.requirements])
outputs = flight.evaluate([drawn() for _ in range(20_000)])
for column, row in enumerate(result.probabilities[: len(case.requirements)]):
    violated = np.mean(~case.requirements[column].is_met(outputs[:, column]))
    print(
        f"{row.requirement:15} before {row.before.mean:.1e} (at most {row.before.upper95:.1e})"
        f" after {row.after.mean:.1e} (at most {row.after.upper95:.1e}) truth {violated:.1e}: {row.verdict}"
    )

# %%
# What more tests would buy for the velocity: the expected bound, and how likely they are to decide.
[outlook] = [row for row in result.outlooks if row.requirement == "axial velocity"]
for row in outlook.measured:
    decided = 100.0 * (row.decided or 0.0)
    print(f"{row.number:3} more tests: 95 % bound {row.bound:.1e}, decided in {decided:.0f} % of futures")
print(f"without any model: {outlook.model_free} tests without a failure")

# %%
# What is known of the probability before and after.
graph = update.drawProbability("axial velocity")
view = otv.View(graph)
