"""How the kernels are compiled: with fused multiply-add and IEEE division, and kept on disk at the entry points alone.

"contract" alone keeps the result of a run the same in every batch, and leaves NaN and infinity meaningful.

Numba renews a cached function when its own file changes, not when a function that it calls does. Inner kernels are
therefore not cached, and an entry point is a closure over `SOURCE_DIGEST`, which its cache key contains: a change
anywhere in this folder compiles anew. Kernels therefore import nothing of the package from outside of it.

What the cache lacks is compiled by processes of their own, which work at once (`prepare`). Only entry points become
machine code. No process can link one to a kernel that was compiled alone, whose products and sums may be fused
otherwise: one that compiles computes the same bits as those that load.
"""

import hashlib
import pickle
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba import njit
from numba._dynfunc import make_function
from numba.core import event
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.dispatcher import Dispatcher
from numba.core.typed_passes import AnnotateTypes, NativeLowering

OPTIONS = {"error_model": "numpy", "fastmath": {"contract"}, "_nrt": False}


class _InnerLibrary(JITCodeLibrary):
    """A kernel in the form that those around it take in: optimised, but no machine code."""

    def _finalize_final_module(self):
        self._finalize_dynamic_globals()
        self._finalized = True


class _Pass(LoweringPass):
    def __init__(self):
        LoweringPass.__init__(self)


@register_pass(mutates_CFG=False, analysis_only=False)
class _TakeInnerLibrary(_Pass):
    _name = "satsep_ot_take_inner_library"

    def run_pass(self, state):
        state.library = _InnerLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        state.flags.no_compile = True
        return True


@register_pass(mutates_CFG=False, analysis_only=False)
class _OfferToCallers(_Pass):
    _name = "satsep_ot_offer_to_callers"

    def run_pass(self, state):
        lowered, library = state.cr, state.library
        library.finalize()
        # Callers find a kernel by its function in Python. Nothing calls that: its address is 0.
        function = make_function(
            lowered.fndesc.lookup_module(), lowered.fndesc.qualname, "", 0, lowered.env, (library,)
        )
        state.targetctx.insert_user_function(function, lowered.fndesc, [library])
        state.cr = lowered._replace(cfunc=function)
        return True


class _KernelCompiler(CompilerBase):
    """Numba's compiler, but only entry points become machine code.

    Numba would make the machine code of each kernel, and again in each kernel that calls it: a sixth of the time.
    """

    def define_pipelines(self):
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_TakeInnerLibrary, AnnotateTypes)
        passes.add_pass_after(_OfferToCallers, NativeLowering)
        passes.finalize()
        return [passes]


# Functions that only kernels call need no way in from Python, which costs a third of the time to compile them.
KERNEL = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": _KernelCompiler, **OPTIONS}
# Small functions of inner loops: a call that passes arrays would cost more than what they do.
INLINE = {"forceinline": True, **KERNEL}


def kernel(function: Callable) -> Any:
    """Compile a function that only kernels call."""
    return njit(**KERNEL)(function)


def inline(function: Callable) -> Any:
    """Compile a small function into the kernels that call it; Python calls it as it is.

    Numba's `register_jitable` would compile it once more for callers with other options.
    """
    function.compiled = njit(**INLINE)(function)  # kept here: the type below refers to it weakly
    if isinstance(function.compiled, Dispatcher):  # not plain Python
        function._numba_type_ = numba.typeof(function.compiled)
    return function


def choice(functions: Sequence[Callable]) -> Any:
    """One function that calls functions[number], with `number` as an argument in front of theirs.

    They are plain Python or compiled.
    """
    functions = [function if isinstance(function, Dispatcher) else inline(function) for function in functions]
    chosen = functions[-1]

    @inline
    def choose(number, *arguments):
        return chosen(*arguments)

    for number, function in reversed(list(enumerate(functions[:-1]))):
        choose = _branch(np.int64(number), function, choose)
    return choose


def _branch(own, function, others):
    @inline
    def choose(number, *arguments):
        if number == own:
            return function(*arguments)
        return others(number, *arguments)

    return choose


def integers(*values: int) -> np.ndarray:
    """Constants for the kernels: numba compiles a function anew for every Python integer that it is called with."""
    return np.array(values, dtype=np.int64)


@inline
def larger(a, b):
    """The larger of two numbers; `max` and `min` cost numba more to compile."""
    return b if b > a else a


@inline
def smaller(a, b):
    """The smaller of two numbers."""
    return b if b < a else a


def _digest(folder):
    """A number that changes with any source file in the folder and below it."""
    content = b"".join(path.read_bytes() for path in sorted(folder.rglob("*.py")))
    return int.from_bytes(hashlib.sha256(content).digest()[:6], "big")


SOURCE_DIGEST = _digest(Path(__file__).parent)


def entry_point(function: Callable) -> Any:
    """Compile a function that Python calls, and keep it on disk where there is a folder for it that can be written.

    It is to be a closure that uses `SOURCE_DIGEST`.
    """
    try:
        return njit(nogil=True, cache=True, **OPTIONS)(function)
    except RuntimeError as error:
        warnings.warn(
            f"{error}; every process will compile it: set NUMBA_CACHE_DIR to a folder that can be written",
            RuntimeWarning,
            stacklevel=2,
        )
        return njit(nogil=True, **OPTIONS)(function)


class _NotInCache(Exception):
    pass


class _Refusal(event.Listener):
    """Raises where numba begins to compile a function, which it has not found in the cache then."""

    def __init__(self, function):
        self._function = function

    def on_start(self, begun):
        if begun.data["dispatcher"] is self._function:
            raise _NotInCache

    def on_end(self, ended):
        pass


_CHILD = """
import importlib, pickle, sys
sys.path[:] = pickle.load(sys.stdin.buffer)
module, name, types = pickle.load(sys.stdin.buffer)
getattr(importlib.import_module(module), name).compile(types)
"""
_preparing = threading.Lock()


def prepare(calls: Mapping[Any, tuple]) -> None:
    """Load entry points from the cache; those that it lacks are compiled into it first, each by a process of its own.

    Where such a process fails or there is no cache, this process will compile what it calls.

    Parameters
    ----------
    calls : mapping of entry point to tuple
        The arguments that each of them may be called with.
    """
    if all(getattr(function, "signatures", True) for function in calls):  # plain Python where nothing is compiled
        return
    with _preparing:
        types = {function: tuple(map(numba.typeof, arguments)) for function, arguments in calls.items()}
        missing = [function for function in calls if not _loaded(function, types[function])]
        # A program that Python is embedded in is not to be started a second time.
        if "python" in Path(sys.executable or "").name:
            _compile_apart({function: types[function] for function in missing if function.stats.cache_path})


def _loaded(function, types):
    """Is it in the cache? Then it is loaded."""
    try:
        with event.install_listener("numba:compile", _Refusal(function)):
            function.compile(types)
    except _NotInCache:
        return False
    return True


def _compile_apart(types):
    children = []
    try:
        for function, arguments in types.items():
            child = subprocess.Popen(
                [sys.executable, "-c", _CHILD],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            children.append(child)
            with child.stdin as pipe:
                pickle.dump(sys.path, pipe)
                pickle.dump((function.__module__, function.__name__, arguments), pipe)
        for child in children:
            child.wait()
    except OSError:
        pass  # as where a process fails later
    finally:
        for child in children:
            child.kill()
            child.wait()
