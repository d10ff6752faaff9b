"""What a user chooses of an `ActiveSubspaceReliability`, as one record that its run is given."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import openturns as ot

MODES = ("fast", "safe")
_OUTSIDE = ("progressCallback", "stopCallback", "checkpointFile", "checksModel", "asks")
_LATER = ("blockSize", "lowFidelity")


@dataclasses.dataclass
class ReliabilitySettings:
    """Settings of one run, checked by the setters of `ActiveSubspaceReliability`, which describe them."""

    function: ot.Function | None = None
    composition: ot.Function | None = None
    smoothIndices: Sequence[int] | None = None
    surrogateComposition: ot.Function | None = None
    lowFidelity: ot.Function | None = None
    targetCoefficientOfVariation: float = 0.05
    maximumEvaluations: int = 5000
    allowedProbability: float | None = None
    verdictCoefficientOfVariation: float = math.inf
    mode: str = "fast"
    nonFinitePolicy: str = "raise"
    blockSize: int | None = None
    knownRuns: tuple[ot.Sample, ot.Sample, ot.Distribution | None] | None = None
    progressCallback: Callable[[float], None] | None = None
    stopCallback: Callable[[], bool] | None = None
    checkpointFile: Path | None = None
    checksModel: bool = True
    # Whether a run that the checkpoint file lacks is asked for instead of made.
    asks: bool = False

    def deciding(self) -> dict[str, Any]:
        """Those that decide on the runs, by name."""
        return {
            field.name: getattr(self, field.name)
            for field in dataclasses.fields(self)
            if field.name not in _OUTSIDE
            # Checkpoints of earlier versions do not have these.
            and not (field.name in _LATER and getattr(self, field.name) is None)
        }
