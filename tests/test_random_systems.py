"""The family of random systems, its probabilities found a second way, and the table of an estimator on it."""

import json
import math

import numpy as np
import pytest
from benchmarks import random_systems as family
from benchmarks import trust_of_estimates as trust
from scipy import integrate
from scipy.special import ndtr

# The first seeds of each kind; all seeds are checked by the command.
FIRST_SEEDS = {}
for _seed in family.DESIGN:
    FIRST_SEEDS.setdefault(family.random_system(_seed).kind, _seed)


@pytest.mark.parametrize("kind", family.KINDS)
def test_event_of_each_kind_has_its_probability(kind):
    system = family.random_system(FIRST_SEEDS[kind])
    mean, error = family.importance_sampling(system, 8000)
    assert abs(mean - system.probability) < 4.5 * error < 0.4 * mean


# By the signs of the margin along the first coordinate, and a trapezoidal rule over the second one.
ONE_DIMENSION = ("linear", "cubic", "absolute", "two_sided", "band")
TWO_DIMENSIONS = ("quadratic", "ramp", "step", "corner", "island")


def probability_along_a_line(value):
    """P(value(a) <= 0) of a standard normal a, from the sign changes on a fine grid."""
    a = np.linspace(-9.0, 9.0, 9_001)
    failed = value(a) <= 0.0
    changes = np.flatnonzero(failed[1:] != failed[:-1])
    middle = 0.5 * (a[changes] + a[changes + 1])
    enters = np.where(failed[changes + 1], 1.0, -1.0)
    return sum(sign * ndtr(-crossing) for sign, crossing in zip(enters, middle, strict=True)) + float(failed[0])


@pytest.mark.parametrize("name", ONE_DIMENSION)
@pytest.mark.parametrize("p", [1e-9, 1e-4, 1e-1])
def test_probability_of_a_part_along_one_coordinate(name, p):
    part = getattr(family, name)(np.random.default_rng(3), p)
    assert part.probability == pytest.approx(p, rel=1e-6)
    assert probability_along_a_line(lambda a: part.value(a[:, None])) == pytest.approx(p, rel=8e-3)


@pytest.mark.parametrize("name", TWO_DIMENSIONS)
@pytest.mark.parametrize("p", [1e-7, 1e-2])
def test_probability_of_a_part_over_two_coordinates(name, p):
    part = getattr(family, name)(np.random.default_rng(4), p)
    assert part.probability == pytest.approx(p, rel=1e-6)
    t = np.linspace(-8.0, 8.0, 1601)
    lines = [probability_along_a_line(lambda a, t=t: part.value(np.column_stack([a, np.full_like(a, t)]))) for t in t]
    density = np.exp(-0.5 * t**2) / math.sqrt(2.0 * math.pi)
    assert integrate.trapezoid(lines * density, t) == pytest.approx(p, rel=0.03)


@pytest.mark.parametrize("name", family.LINKS)
def test_links_increase_and_keep_the_sign(name):
    m = np.linspace(-4.0, 4.0, 201)
    seen = family.LINKS[name](m)
    assert (np.diff(seen) > 0.0).all()
    assert (np.sign(seen) == np.sign(m)).all()


def test_inputs_come_back_to_independent_standard_normal_ones():
    rng = np.random.default_rng(0)
    for _ in range(12):
        _, distribution = family.random_inputs(rng, 9)
        u = rng.normal(size=(50, 9))
        u[:10] *= 6.5 / np.linalg.norm(u[:10], axis=1, keepdims=True)
        x = np.array(distribution.getInverseIsoProbabilisticTransformation()(u))
        np.testing.assert_allclose(family.standard_normal_map(distribution)(x), u, atol=2e-5)


def test_family_is_as_wide_as_it_says():
    systems = [family.random_system(seed) for seed in family.DESIGN]
    shares = {kind: np.mean([system.kind == kind for system in systems]) for kind in family.KINDS}
    assert all(abs(shares[kind] - share) < 0.1 for kind, share in family.KINDS.items())
    probabilities = np.array([system.probability for system in systems])
    assert 5e-10 < probabilities.min() < 1e-8
    assert 1e-2 < probabilities.max() < 0.11
    dimensions = [system.dimension for system in systems]
    assert (min(dimensions), max(dimensions) > 80) == (2, True)
    assert all(np.allclose(s.directions.T @ s.directions, np.eye(s.directions.shape[1])) for s in systems)
    assert not set(family.DESIGN) & set(family.HELD_OUT)
    assert all(f"P = {system.probability:.4e}" in system.describe() for system in systems)


def test_same_seed_gives_the_same_system():
    first, second = family.random_system(12), family.random_system(12)
    x = np.array(first.distribution.getSample(5))
    np.testing.assert_array_equal(first.evaluate(x), second.evaluate(x))
    assert first.describe() == second.describe()


# The table. -----------------------------------------------------------------------------------------------------------


def row(seed, estimate, bounds95, bounds999, converged=True, method="ActiveSubspace"):
    system = {"seed": seed, "kind": "single", "dimension": 2, "truth": 1e-3}
    bounds = dict(zip(("lower95", "upper95", "lower999", "upper999"), (*bounds95, *bounds999), strict=True))
    answer = {"estimate": estimate, "claimed": 0.05, "runs": 100 * seed, "seconds": 1.0}
    return system | answer | bounds | {"converged": converged, "method": method}


def test_summary_counts_what_it_says():
    rows = [
        row(1, 1.0e-3, (0.9e-3, 1.1e-3), (0.8e-3, 1.2e-3)),
        row(2, 1.1e-3, (1.05e-3, 1.2e-3), (0.9e-3, 1.3e-3)),
        row(3, 0.5e-3, (0.4e-3, 0.6e-3), (0.3e-3, 0.7e-3)),
        row(4, 1.0e-3, (0.9e-3, 1.1e-3), (0.8e-3, 1.2e-3), method="SubsetSampling"),
        row(5, 0.1e-3, (0.0, 0.2e-3), (0.0, 0.3e-3), converged=False),
        row(6, 1.0e-3, (0.0, 1.0), (0.0, 1.0), converged=False, method="SubsetSampling"),
        {"seed": 7, "kind": "pair", "dimension": 3, "truth": 1e-4, "error": "not finished"},
        {"seed": 8, "kind": "pair", "dimension": 3, "truth": 1e-4, "error": "ValueError: no"},
    ]
    assert [trust.status(r) for r in rows] == [
        "converged", "converged", "converged", "handed, conv.", "refused", "handed over", "not finished", "error"
    ]  # fmt: skip
    assert [trust.line(r).endswith("WRONG") for r in rows] == [False, False, True, *[False] * 5]
    text = "\n".join(trust.summary(rows))
    assert "converged: 4 (50.0 %)" in text
    assert "confidently wrong: 1 of 4 converged (25.0 %)" in text
    assert "hold the truth: 2 of 4 (50.0 %)" in text
    assert "medians of converged ones: 250 runs" in text
    assert "25.5 % real, 5.0 % claimed" in text
    assert "without the confidently wrong ones: 5.8 % real" in text
    assert "outside the 99.9 % interval: 1 of 2" in text


def test_a_run_is_a_row_and_is_not_repeated(tmp_path):
    path = tmp_path / "rows.jsonl"
    # A single quadratic mode.
    rows, versions = trust.run([FIRST_SEEDS["single"]], path, target=0.3, evaluations=2000)
    assert [json.loads(text) for text in path.read_text().splitlines()] == rows
    assert rows[0]["lower95"] <= rows[0]["estimate"] <= rows[0]["upper95"]
    assert rows[0]["runs"] <= 2000
    assert versions["satsep_ot"]
    assert trust.run([FIRST_SEEDS["single"]], path, target=0.3, evaluations=2000) == (rows, {})
    with pytest.raises(ValueError, match="another target"):
        trust.run([FIRST_SEEDS["single"]], path)


def test_a_run_out_of_time_is_ended():
    (ended,), _ = trust.run([FIRST_SEEDS["single"]], seconds=0.01)
    assert trust.status(ended) == "not finished"
    assert trust.line(ended).endswith("not finished")
