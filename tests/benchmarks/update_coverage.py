"""Whether updates by ground tests are right: calibration, coverage, false alarms and alarms on the reference case.

    python tests/benchmarks/update_coverage.py [CAMPAIGNS] [--seed N] [--workers N]

The truth of each campaign is drawn from what the case says before any test. Ten tests measure velocity and rates, and
twelve springs of the batch are measured. The truth's probabilities are computed as those of the update are, with more
runs. A campaign that is off has 3 predictive standard deviations added to one quantity in all its tests.
"""

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import openturns as ot
from scipy import stats

import satsep_ot
from satsep_ot.methods.updating.experiments import MeasurementModel
from satsep_ot.methods.updating.failure_probability import FailureProbabilities
from satsep_ot.methods.updating.misfit import findMisfits, madeUpCampaigns
from satsep_ot.methods.updating.posterior import Method, UpdatingError, samplePosterior
from satsep_ot.methods.updating.two_level import normals
from satsep_ot.model.case import new_case_text, parse_case
from satsep_ot.model.ground_tests import parse_ground_tests
from satsep_ot.studies.separation_update import SeparationUpdate

ERRORS = {"axial_velocity": 5e-4, "rate_x": 0.02, "rate_y": 0.02, "rate_z": 0.02}
TESTS, SPRINGS = 10, 12
RANKS = 100
BLOCK = 10  # campaigns from one seed
# What the tests are to teach, beside the satellite that the reference case shares.
UNCERTAIN = {
    'stiffness = { quantity = "springs.stiffness.each",': ' mean_uncertainty = "0.5 %",',
    'cant = { quantity = "springs.cant.each",': ' mean_uncertainty = 0.1, sigma_uncertainty = "20 %",',
    'rate_y = { quantity = "initial.rates.y",': ' sigma_uncertainty = "20 %",',
}


def uncertain_case():
    """The reference case, with means and sigmas that are known only roughly."""
    text = new_case_text("reference", "campaign")
    for start, more in UNCERTAIN.items():
        assert start in text
        text = text.replace(start, start + more)
    return parse_case(text, "campaign.toml")


def campaign_table():
    """The table of a campaign, with values that are made up afterwards."""
    rows = [f"drop {k},{name},0,{error}" for k in range(TESTS) for name, error in ERRORS.items()]
    rows += [f"spring {k},stiffness,0,5" for k in range(SPRINGS)]
    return "\n".join(["test,quantity,value,sigma", *rows])


def run_block(task):
    """Some campaigns from one seed: ranks, whether bounds hold, bound / truth, alarms, and effective sizes."""
    campaigns, seed = task
    ot.RandomGenerator.SetSeed(seed)
    case = uncertain_case()
    update = SeparationUpdate(case, parse_ground_tests(campaign_table(), case))
    inputs, (limits, flight) = update._inputs, update._limits()
    model = MeasurementModel(inputs, update._experiments)
    made_up = madeUpCampaigns(model)
    sigma = made_up.std(axis=0, ddof=1)
    names, found = list(ERRORS), []
    for number in range(campaigns):
        truth = normals(1, model.parameterNumber)
        values = model.predict(truth)[0] + model.errors * normals(len(model.errors))
        set_values(model, values)
        false_alarm = any(row.contradicts for row in findMisfits(model, made_up))
        posterior = samplePosterior(model, 1000)
        ranks = (posterior.resampled(RANKS) < truth).sum(axis=0)
        probabilities = FailureProbabilities(inputs, flight, limits)
        true = probabilities.compute(truth)[0]
        bounds = np.quantile(probabilities.compute(posterior.resampled(300)), 0.95, axis=0)
        off = names[number % len(names)]
        sign = np.sign(ot.RandomGenerator.Generate() - 0.5)
        set_values(model, values + np.array([3.0 * sign * (name == off) for _, name in model.labels]) * sigma)
        try:
            alarm = any(row.contradicts for row in findMisfits(model, made_up))
        except UpdatingError:
            alarm = True
        found.append((ranks, true <= bounds, bounds / np.maximum(true, 1e-12), false_alarm, alarm,
                      posterior.effectiveSize, posterior.method is Method.CHAINS))  # fmt: skip
    return inputs.getParameters(), [limit.name for limit in limits], found


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("campaigns", type=int, nargs="?", default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    begin = time.perf_counter()
    sizes = [min(BLOCK, options.campaigns - first) for first in range(0, options.campaigns, BLOCK)]
    tasks = [(size, 1000 * options.seed + block) for block, size in enumerate(sizes)]
    rows, parameters, limits = [], [], []
    with ProcessPoolExecutor(options.workers) as pool:
        for block in pool.map(run_block, tasks):
            parameters, limits, found = block
            rows += found
            print(f"# {len(rows)} campaigns, {time.perf_counter() - begin:.0f} s", file=sys.stderr, flush=True)
    columns = map(np.array, zip(*rows, strict=True))
    ranks, covered, widths, false_alarms, alarms, effective, chains = columns
    report(options, parameters, limits, ranks, covered, widths)
    total = len(rows)
    print(f"\nright campaigns said to contradict the case: {false_alarms.sum()} of {total}; at most 7 % are wanted")
    print(
        f"campaigns 3 standard deviations off in one quantity, flagged: {alarms.sum()} of {total}; at least 80 % wanted"
    )
    print(f"effective size of 1000 draws: median {np.median(effective):.0f}, least {effective.min():.0f}; "
          f"Markov chains in {chains.sum()} campaigns")  # fmt: skip
    print(f"satsep_ot {satsep_ot.__version__}, OpenTURNS {ot.__version__}, numpy {np.__version__}")


def set_values(model, values):
    """Give the experiments of a model other values."""
    model.values = values
    place = 0
    for experiment in model.experiments:
        for row in experiment.measurements:
            # The rows are frozen for everybody else.
            object.__setattr__(row, "value", float(values[place]))
            place += 1


def report(options, parameters, limits, ranks, covered, widths):
    total = len(ranks)
    print(f"{total} campaigns of {TESTS} tests and {SPRINGS} springs, seed {options.seed}\n")
    print("ranks of the truth among 100 draws of the posterior, in ten classes; chi-square with 9 degrees of freedom:")
    limit = stats.chi2.ppf(0.99, 9)
    for k, row in enumerate(parameters):
        counts = np.bincount(np.minimum(ranks[:, k] * 10 // (RANKS + 1), 9), minlength=10)
        chi = float(((counts - total / 10) ** 2 / (total / 10)).sum())
        print(f"  {row.name.split(' ')[0] + ' ' + row.kind:22} {' '.join(f'{n:3d}' for n in counts)}   {chi:5.1f}"
              f"{'  beyond the 99 % band of ' + format(limit, '.1f') if chi > limit else ''}")  # fmt: skip
    low, high = stats.binom.ppf([0.005, 0.995], total, 0.1)
    print(f"  the 99 % band of a single class is {low:.0f} to {high:.0f}")
    print("\n95 % upper bound of the probability in flight against the truth's:")
    for j, one in enumerate(limits):
        share = covered[:, j].mean()
        print(f"  {one:16} holds in {covered[:, j].sum():3d} ({100 * share:.1f} %), "
              f"median bound / truth {np.median(widths[:, j]):.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
