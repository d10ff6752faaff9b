"""What an update of the reference case by ten tests and twelve springs takes, with the default settings.

    python tests/benchmarks/update_time.py

The seconds of processors count what the update itself takes; those of the clock depend on what else the machine does.
"""

import os
import time

import openturns as ot
from update_coverage import SPRINGS, TESTS, campaign_table, set_values, uncertain_case

from satsep_ot.methods.updating.experiments import MeasurementModel
from satsep_ot.methods.updating.two_level import normals
from satsep_ot.model.ground_tests import parse_ground_tests
from satsep_ot.studies.separation_update import SeparationUpdate

ot.RandomGenerator.SetSeed(0)
case = uncertain_case()
update = SeparationUpdate(case, parse_ground_tests(campaign_table(), case), seed=1)
model = MeasurementModel(update._inputs, update._experiments)
set_values(model, model.predict(normals(1, model.parameterNumber))[0] + model.errors * normals(len(model.errors)))
wall, processors = time.perf_counter(), time.process_time()
update.run()
wall, processors = time.perf_counter() - wall, time.process_time() - processors
one = update.getResult().sampling
print(f"{TESTS} tests, {SPRINGS} springs: {processors:.1f} s of processors, {wall:.1f} s by the clock")
print(f"on {os.cpu_count()} cores with a load of {os.getloadavg()[0]:.1f}")
print(f"{one.runs:,} runs, {one.gradients} gradients; {one.method}, worth {one.effective_size:.0f} draws")
