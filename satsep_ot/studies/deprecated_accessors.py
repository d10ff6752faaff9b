"""Accessors of a study under their old names, which version 0.3 removes: all that they told is in its `getResult`."""

from typing import Any

from satsep_ot.deprecation import warnDeprecated
from satsep_ot.studies.telling.document import results_document
from satsep_ot.studies.telling.plain_data import to_plain
from satsep_ot.studies.telling.remarks import remarks
from satsep_ot.studies.telling.results import StudyResult
from satsep_ot.studies.telling.verdicts import Verdict, judge_all


class DeprecatedAccessors:
    """The old accessors, of a class with `getResult`."""

    def getResult(self) -> StudyResult:
        """All that was found."""
        raise NotImplementedError

    def getRows(self) -> list[dict]:
        """Deprecated: `getResult().rows`."""
        warnDeprecated("getRows", "getResult().rows")
        return to_plain(self.getResult().rows)

    def getRemarks(self) -> list[str]:
        """Deprecated: `satsep_ot.studies.telling.remarks.remarks`."""
        warnDeprecated("getRemarks", "satsep_ot.studies.telling.remarks.remarks")
        return remarks(self.getResult())

    def getVerdicts(self) -> list[Verdict]:
        """Deprecated: `satsep_ot.studies.telling.verdicts.judge_all`."""
        warnDeprecated("getVerdicts", "satsep_ot.studies.telling.verdicts.judge_all")
        return judge_all(self.getResult())

    def getDriverShares(self, requirement: str) -> dict[str, float]:
        """Deprecated: `getResult().drivers`."""
        warnDeprecated("getDriverShares", "getResult().drivers")
        return self.getResult().drivers[requirement]

    def getTolerances(self) -> dict[str, list[dict]]:
        """Deprecated: `getResult().tightened`."""
        warnDeprecated("getTolerances", "getResult().tightened")
        return to_plain(self.getResult().tightened)

    def getTightenedRatios(self) -> dict[str, dict[str, float]]:
        """Deprecated: `getResult().ratios`."""
        warnDeprecated("getTightenedRatios", "getResult().ratios")
        return self.getResult().ratios

    def getResults(self) -> dict[str, Any]:
        """Deprecated: `satsep_ot.studies.telling.document.results_document`."""
        warnDeprecated("getResults", "satsep_ot.studies.telling.document.results_document")
        return results_document(self.getResult())
