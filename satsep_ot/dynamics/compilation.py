"""How the kernels are compiled: once, kept on disk, with fused multiply-add and IEEE division.

"contract" alone keeps the result of a run the same in every batch, and leaves NaN and infinity meaningful.
"""

OPTIONS = {"cache": True, "error_model": "numpy", "fastmath": {"contract"}}
