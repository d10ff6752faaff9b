"""Failures of parts: what may fail with a probability, and the case in which it has failed."""

import dataclasses

import numpy as np

from satsep_ot.dynamics.separation import Separation


@dataclasses.dataclass(frozen=True)
class PartFailure:
    """A part that fails with a probability, independent of the other parts.

    Attributes
    ----------
    part : str
        For example "spring 2".
    probability : float
        Above 0.
    parameters : dict of str to float
        What the parameters of the separation are then, by their names [SI].
    """

    part: str
    probability: float
    parameters: dict[str, float]


def failed_separation(separation: Separation, failure: PartFailure) -> Separation:
    """The separation in which a part has failed.

    Parameters
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`
    failure : PartFailure

    Returns
    -------
    separation : :class:`satsep_ot.dynamics.separation.Separation`

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.failures import PartFailure, failed_separation
    >>> failure = PartFailure("spring 2", 1e-3, {"springs[1].scale": 0.0})
    >>> print(failed_separation(load_case("reference").separation, failure).springs.scale)
    [1. 0. 1. 1.]
    """
    vector = separation.parameters()
    set_failed(vector[None], separation, failure)
    return separation.with_parameters(vector)


def set_failed(parameters: np.ndarray, separation: Separation, failure: PartFailure) -> None:
    """Give the parameters (n, P) of some runs, in place, the values of a part that has failed."""
    names = separation.parameter_names()
    for name, value in failure.parameters.items():
        parameters[:, names.index(name)] = value
