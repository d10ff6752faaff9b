"""How the kernels are compiled: with fused multiply-add and IEEE division, and kept on disk at the entry points alone.

"contract" alone keeps the result of a run the same in every batch, and leaves NaN and infinity meaningful.

Numba renews a cached function when its own file changes, not when a function that it calls does. Inner kernels are
therefore not cached, and an entry point is a closure over `SOURCE_DIGEST`, which its cache key contains: a change
anywhere in this folder compiles anew.
"""

import hashlib
from pathlib import Path

from numba import njit

OPTIONS = {"error_model": "numpy", "fastmath": {"contract"}, "_nrt": False}
# Functions that only kernels call need no way in from Python, which costs a third of the time to compile them.
KERNEL = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, **OPTIONS}
# Functions whose products and sums the compiler would fuse otherwise where it compiles them into an entry point than
# where it compiles them alone: the process that compiles and those that load from the cache must agree to the last bit.
EXACT = {**KERNEL, "fastmath": False}
# Small functions of inner loops: a call that passes arrays would cost more than what they do.
INLINE = {"forceinline": True, **KERNEL}


@njit(**INLINE)
def known(index):
    """The index itself, for the compiler to see that it is not negative.

    Where numba must allow for an index from the end, the compiler makes no vector instructions of a loop.
    """
    return index & 0xFFFFF


@njit(**INLINE)
def larger(a, b):
    """The larger of two numbers; `max` and `min` cost numba more to compile."""
    return b if b > a else a


@njit(**INLINE)
def smaller(a, b):
    """The smaller of two numbers."""
    return b if b < a else a


def _digest(folder):
    """A number that changes with any source file in the folder."""
    content = b"".join(path.read_bytes() for path in sorted(folder.glob("*.py")))
    return int.from_bytes(hashlib.sha256(content).digest()[:6], "big")


SOURCE_DIGEST = _digest(Path(__file__).parent)
