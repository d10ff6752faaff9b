"""Peers that share no code with the simulator find the same: scipy's solve_ivp, and a loop in C."""

import pytest
from benchmarks import simulator_peers as peers


@pytest.mark.parametrize("case", [peers.guided_case, peers.reference_case])
def test_scipy_finds_the_same(case):
    separation, rows = case(2, seed=1)
    ours, scipy = peers.our_summary(separation, rows, 1e-12), peers.scipy_summary(separation, rows, rtol=1e-11)
    assert peers.largest_difference(ours, scipy) < 1e-9


def test_the_c_loop_finds_the_same(tmp_path):
    run = peers.compile_c(tmp_path)
    if run is None:
        pytest.skip("there is no C compiler (gcc or cc) here")
    separation, rows = peers.guided_case(200, seed=1)
    exact = peers.our_summary(separation, rows, 1e-12)
    for tolerance, limit in ((1e-8, 1e-7), (1e-12, 1e-11)):
        assert peers.largest_difference(exact, peers.c_summary(run, separation, rows, tolerance)) < limit
