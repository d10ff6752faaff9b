"""Whether measurements contradict the model that they are to update."""

import dataclasses

import numpy as np

from satsep_ot.methods.updating.experiments import MeasurementModel
from satsep_ot.methods.updating.posterior import UpdatingError
from satsep_ot.methods.updating.two_level import normals

REPLICATES = 2000
# Chances of a false alarm of a right model: of all quantities together, and of all single measurements together.
QUANTITY_LEVEL = 0.03
MEASUREMENT_LEVEL = 0.02
LARGEST_DEVIATION = 10.0  # predictive standard deviations: nothing can be learnt from what lies farther off


@dataclasses.dataclass(frozen=True)
class Misfit:
    """How one measurement, or the mean of one quantity over the experiments, lies in what the model predicts.

    Attributes
    ----------
    experiment : str
        Empty for the mean of a quantity.
    quantity : str
    value, predicted, sigma : float
        Measured, and mean and standard deviation of the prediction before any measurement.
    deviation : float
        In these standard deviations.
    fromOthers : float or None
        Deviation from what the other experiments let expect; None for the mean of a quantity.
    probability : float
        That a right model has so large a deviation anywhere among its kind: all quantities, or all measurements.
    contradicts : bool
    """

    experiment: str
    quantity: str
    value: float
    predicted: float
    sigma: float
    deviation: float
    fromOthers: float | None
    probability: float
    contradicts: bool


def madeUpCampaigns(model: MeasurementModel) -> np.ndarray:
    """Measurements of 2000 campaigns as the model makes them up before any measurement, ndarray (R, K).

    Raises
    ------
    UpdatingError
        Most of them cannot be computed.
    """
    predicted = model.predict(normals(REPLICATES, model.parameterNumber))
    predicted = predicted[np.isfinite(predicted).all(axis=1)]
    if len(predicted) < REPLICATES // 2:
        raise UpdatingError(
            f"{REPLICATES - len(predicted)} of {REPLICATES} made-up runs of the tests cannot be computed; check the "
            "conditions of the tests"
        )
    return predicted + model.errors * normals(*predicted.shape)


def findMisfits(model: MeasurementModel, campaigns: np.ndarray) -> list[Misfit]:
    """Compare measurements with campaigns that the model makes up.

    Each measurement is judged by its predictive distribution before any measurement and after all other experiments,
    each quantity by its mean over the experiments. The limits follow from the largest deviations in 2000 made-up
    campaigns (Westfall and Young's adjustment): whatever the number of measurements, a right model is said to be
    contradicted in 5 % of campaigns.

    Parameters
    ----------
    model : MeasurementModel
    campaigns : ndarray (R, K)
        As `madeUpCampaigns` gives them.

    Returns
    -------
    misfits : list of Misfit
        Quantities first.

    Raises
    ------
    UpdatingError
        A measurement more than ten standard deviations off.
    """
    mean, sigma = campaigns.mean(axis=0), campaigns.std(axis=0, ddof=1)
    scores, measured = (campaigns - mean) / sigma, (model.values - mean) / sigma
    names = list(dict.fromkeys(name for _, name in model.labels))
    averages = np.array([[float(name == other) for _, other in model.labels] for name in names]).T
    averages /= averages.sum(axis=0)
    means = campaigns @ averages
    meanSigma = means.std(axis=0, ddof=1)
    of_means = (means - means.mean(axis=0)) / meanSigma, (model.values @ averages - means.mean(axis=0)) / meanSigma
    experiments = np.array([list(dict.fromkeys(e for e, _ in model.labels)).index(e) for e, _ in model.labels])
    conditional = _fromOthers(scores, experiments)
    residuals, residual = scores @ conditional, measured @ conditional
    width = residuals.std(axis=0, ddof=1)
    residuals, residual = residuals / width, residual / width
    largest = np.maximum(np.abs(scores), np.abs(residuals)).max(axis=1)
    largestMean = np.abs(of_means[0]).max(axis=1)
    found = []
    for k, name in enumerate(names):
        chance = float(np.mean(largestMean >= abs(of_means[1][k])))
        value = float(model.values @ averages[:, k])
        found.append(
            Misfit(
                "", name, value, float(means[:, k].mean()), float(meanSigma[k]), float(of_means[1][k]), None, chance,
                chance < QUANTITY_LEVEL,
            )
        )  # fmt: skip
    for k, (experiment, name) in enumerate(model.labels):
        chance = float(np.mean(largest >= max(abs(measured[k]), abs(residual[k]))))
        found.append(
            Misfit(
                experiment, name, float(model.values[k]), float(mean[k]), float(sigma[k]), float(measured[k]),
                float(residual[k]), chance, chance < MEASUREMENT_LEVEL,
            )
        )  # fmt: skip
    _refuseImpossible(found)
    return found


def _fromOthers(scores, experiments):
    """The linear map (K, K) from scores to what is left of each after its regression on other experiments."""
    covariance = np.cov(scores, rowvar=False).reshape(scores.shape[1], -1)
    # A thousandth of the variance keeps measurements apart that would be one and the same but for tiny errors.
    covariance += 1e-6 * np.eye(len(covariance))
    left = np.eye(len(covariance))
    for number in np.unique(experiments):
        inside, outside = experiments == number, experiments != number
        if outside.any():
            left[np.ix_(outside, inside)] = -np.linalg.solve(
                covariance[np.ix_(outside, outside)], covariance[np.ix_(outside, inside)]
            )
    return left


def _refuseImpossible(found):
    """Refuse measurements so far off that no update means anything."""
    singles = [row for row in found if row.experiment]
    worst = max(singles, key=lambda row: abs(row.deviation))
    if abs(worst.deviation) > LARGEST_DEVIATION:
        raise UpdatingError(
            f"test {worst.experiment}: {worst.quantity} = {worst.value:g} lies {abs(worst.deviation):.0f} standard "
            f"deviations from {worst.predicted:.6g}, what the model predicts, where at most {LARGEST_DEVIATION:g} are "
            "allowed; check its unit, its sigma and the columns that say how the test differed"
        )
    worst = max(singles, key=lambda row: abs(row.fromOthers or 0.0))
    if abs(worst.fromOthers or 0.0) > LARGEST_DEVIATION:
        others = sorted({row.experiment for row in singles if row.quantity == worst.quantity} - {worst.experiment})
        named = f" ({', '.join(others[:3])}{', ...' if len(others) > 3 else ''})" if others else ""
        raise UpdatingError(
            f"test {worst.experiment}: {worst.quantity} = {worst.value:g} contradicts the other tests{named}: it lies "
            f"{abs(worst.fromOthers or 0.0):.0f} standard deviations from what they let expect, where at most "
            f"{LARGEST_DEVIATION:g} are allowed; check both, or say which inputs are drawn anew"
        )
