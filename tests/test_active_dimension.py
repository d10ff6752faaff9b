"""The criteria for the active dimension on spectra whose answer is known."""

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.subspaces.dimension import (
    cross_validated_dimension,
    energy_dimension,
    gap_dimension,
    ladle_dimension,
)
from satsep_ot.methods.subspaces.estimation import bootstrap_subspace, estimate_subspace

SPECTRA = {
    "isotropic": (0, np.ones(25)),
    "one": (1, np.r_[1.0, np.full(24, 0.01)]),
    "two": (2, np.r_[1.0, 0.5, 0.02 * 0.9 ** np.arange(23)]),
    "three": (3, np.r_[1.0, 0.1, 0.01, np.full(22, 1e-4)]),
}


def gradients_of(spectrum, count, random):
    rotation = np.linalg.qr(random.standard_normal((len(spectrum), len(spectrum))))[0]
    return ((random.standard_normal((count, len(spectrum))) * np.sqrt(spectrum)) @ rotation.T)[:, :, None]


@pytest.fixture
def random():
    ot.RandomGenerator.SetSeed(3)
    return np.random.default_rng(3)


@pytest.mark.parametrize("name", sorted(SPECTRA))
@pytest.mark.parametrize("count", [40, 80])
def test_gap_finds_the_dimension_of_known_spectra(random, name, count):
    rank, spectrum = SPECTRA[name]
    found = [gap_dimension(gradients_of(spectrum, count, random)) for _ in range(10)]
    assert found.count(rank) >= 9, found


def test_gap_with_two_outputs_turns_both_gradients_of_a_point_together(random):
    # Both outputs share the gradient: as independent rows they would look like twice the points.
    shared = gradients_of(np.ones(12), 30, random)
    assert gap_dimension(np.concatenate([shared, 2.0 * shared], axis=2)) == 0
    ridge = gradients_of(np.r_[1.0, 0.5, np.full(10, 0.005)], 30, random)
    assert gap_dimension(np.concatenate([ridge, -ridge], axis=2)) == 2


def test_one_long_gradient_is_not_a_direction(random):
    gradients = random.standard_normal((40, 10, 1))
    gradients[0] *= 30.0
    assert gap_dimension(gradients) == 0


def test_directions_of_a_minority_of_the_points_count(random):
    # g = a + 2 max(b - 1, 0)^2: at five points of six the gradient is that of a alone, and exactly so.
    points = random.standard_normal((200, 8))
    gradients = np.zeros((200, 8, 1))
    gradients[:, 0, 0] = 1.0
    gradients[:, 1, 0] = 4.0 * np.maximum(points[:, 1] - 1.0, 0.0)
    assert gap_dimension(gradients) == 2
    # A function that is flat at most of the points has the direction of the others.
    gradients[:, 0] = 0.0
    assert gap_dimension(gradients) == 1
    rotation = np.linalg.qr(random.standard_normal((8, 8)))[0]
    assert gap_dimension(rotation @ gradients) == 1


def test_points_of_weight_zero_take_no_part(random):
    near = gradients_of(np.r_[1.0, np.full(11, 0.01)], 60, random)
    far = 100.0 * gradients_of(np.ones(12), 90, random)
    weights = np.r_[np.ones(60), np.zeros(90)]
    assert gap_dimension(np.concatenate([near, far]), weights=weights) == 1


@pytest.mark.parametrize("name", ["one", "two"])
def test_a_few_steep_points_do_not_decide(random, name):
    rank, spectrum = SPECTRA[name]
    found = []
    for _ in range(10):
        lengths = np.exp(0.5 * random.standard_normal((40, 1, 1)))
        found.append(gap_dimension(lengths * gradients_of(spectrum, 40, random)))
    assert found.count(rank) >= 9, found


def test_gap_with_little_data():
    assert gap_dimension(np.ones((1, 5, 1))) == 1
    assert gap_dimension(np.ones((2, 1, 1))) == 1
    assert gap_dimension(np.zeros((9, 5, 1))) == 0
    exact = np.outer(np.arange(1.0, 7.0), [0.6, 0.0, 0.8, 0.0, 0.0, 0.0, 0.0, 0.0])[:, :, None]
    assert gap_dimension(exact) == 1


def test_ladle_on_a_wide_gap(random):
    for name in ("one", "two"):
        rank, spectrum = SPECTRA[name]
        gradients = gradients_of(spectrum, 60, random)
        eigenvalues, vectors = estimate_subspace(gradients)
        assert ladle_dimension(eigenvalues, vectors, bootstrap_subspace(gradients, 200, 10)[2]) == rank


def test_energy():
    assert energy_dimension(np.zeros(3)) == 0
    assert energy_dimension([98.0, 1.9, 0.1]) == 2
    assert energy_dimension([1.0, 1.0]) == 2


def test_cross_validation_takes_the_smallest_that_predicts_as_well(random):
    points = random.standard_normal((200, 5))
    values = np.exp(points[:, :1]) + 1e-3 * points[:, 1:2]
    gradients = np.zeros((200, 5, 1))
    gradients[:, 0] = np.exp(points[:, :1])
    gradients[:, 1] = 1e-3
    gradients[:, 2:] = 1e-6 * random.standard_normal((200, 3, 1))
    arguments = (points, values, gradients)
    assert cross_validated_dimension(*arguments, [0, 1], values.var(axis=0), None) == 1
    quadratic = points[:, :1] ** 2 + points[:, 1:2]
    slopes = np.zeros((200, 5, 1))
    slopes[:, 0] = 2.0 * points[:, :1]
    slopes[:, 1] = 1.0
    slopes[:, 2:] = 1e-3 * random.standard_normal((200, 3, 1))
    assert cross_validated_dimension(points, quadratic, slopes, [1, 3, 2], quadratic.var(axis=0), None) == 2


def test_a_zero_matrix_has_no_dimension_by_the_ladle():
    assert ladle_dimension(np.zeros(3), np.eye(3), np.repeat(np.eye(3)[None], 5, axis=0)) == 0
