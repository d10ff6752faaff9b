"""What a worker computes with: the last bits of compiled code depend on its processor and on versions."""

import functools
import hashlib
import os
import platform
from importlib import metadata

_PACKAGES = ("satsep-ot", "openturns", "numpy", "scipy", "numba")
# They let numba compile for another processor.
_SETTINGS = ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")


class MixedProcessorsError(ValueError):
    """Workers differ in their processors or versions, and so may the last bits of what they compute.

    Examples
    --------
    >>> from satsep_ot.methods.parallel.processor import MixedProcessorsError
    >>> print(MixedProcessorsError("a Zen, numpy 2.4", "a Xeon, numpy 2.4"))
    a worker has a Xeon, numpy 2.4, where a Zen, numpy 2.4 is used: the last bits of numbers may differ; use \
workers of one kind, or accept the mixture
    """

    def __init__(self, used: str, other: str) -> None:
        self.used, self.other = used, other
        super().__init__(
            f"a worker has {other}, where {used} is used: the last bits of numbers may differ; use workers of one "
            "kind, or accept the mixture"
        )

    def __reduce__(self):
        return MixedProcessorsError, (self.used, self.other)


@functools.cache
def processorDescription() -> str:
    """The processor of this process with a digest of its features, and the versions of what computes, in one line.

    Examples
    --------
    >>> from satsep_ot.methods.parallel.processor import processorDescription
    >>> "numpy" in processorDescription()
    True
    """
    name, flags = platform.machine(), ""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as stream:
            lines = dict(line.split(":", 1) for line in stream if ":" in line)
        facts = {key.strip(): value.strip() for key, value in lines.items()}
        name = facts.get("model name", name)
        flags = facts.get("flags", facts.get("Features", ""))
    except OSError:
        name = platform.processor() or name
    settings = [f"{key}={os.environ[key]}" for key in _SETTINGS if key in os.environ]
    features = hashlib.sha256(" ".join(sorted(flags.split())).encode()).hexdigest()[:8]
    return ", ".join([name, f"features {features}", *settings, *_versions()])


def _versions():
    for package in _PACKAGES:
        try:
            yield f"{package} {metadata.version(package)}"
        except metadata.PackageNotFoundError:
            yield f"no {package}"
