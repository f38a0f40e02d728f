"""The ``njit`` of all kernels: numba's, with a cache that sees every edit of what a kernel can reach.

numba takes a cached kernel for fresh as long as the kernel's own file is unchanged. What it calls, and the constants
frozen into it, may lie in other files. Here the files of a cached kernel are named by a hash over its own code and, all
the way down, over that of every function it refers to, over the constants, and over the options of the compiler::

    <the place numba chooses>/<module>.<kernel>.<Python>-<hash>.*

The hash is taken of the code in memory when the kernel is first called, so that it fits what is compiled, whatever is
edited meanwhile; comments and the order of functions do not count. The place stays numba's choice:
``NUMBA_CACHE_DIR``, ``__pycache__`` beside the file, or the user's cache; where it finds none to write to, nothing is
cached. A kernel that is saved removes its own files of other hashes. Functions compiled by numba's own ``njit`` are
none of this module's business.
"""

from __future__ import annotations

import contextlib
import hashlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from enum import Enum
from pathlib import Path
from pickle import UnpicklingError
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba
import numpy as np
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

PACKAGE = __name__.partition(".")[0]
DIGITS = 16  # of the hash, in the names of files


def njit(function: Callable | None = None, *, cache: bool = True, **options: Any) -> Any:
    """Compile a function as numba's ``njit`` does, with the cache of this module.

    Parameters
    ----------
    function : callable, optional
        Without it a decorator is returned.
    cache : bool
        Whether compiled code is kept for the next process.
    **options
        As numba's: ``fastmath``, ``error_model``, ...
    """
    if function is None:
        return lambda given: njit(given, cache=cache, **options)
    kernel = numba.njit(function, **options)
    if cache and kernel is not function:  # with NUMBA_DISABLE_JIT it is
        try:
            kernel._cache = _KernelCache(kernel)
        except RuntimeError as error:
            if "cannot cache function" not in str(error):
                raise
    return kernel


def code_hash(kernel: Any) -> str:
    """Return the hash of a kernel's code and of all functions, constants and options that it refers to."""
    parts = hashlib.sha256()
    for part in _reached(kernel, set()):
        parts.update(part + b"\0")
    return parts.hexdigest()[:DIGITS]


def _reached(value: Any, seen: set[int], names: Sequence[str] = ()) -> Iterator[bytes]:
    """Yield what the compiled form of a value depends on, each function once; of a module what `names` pick from it."""
    if isinstance(value, Dispatcher):
        yield from _reached(tuple(sorted(value.targetoptions.items())), seen)
        value = value.py_func
    if isinstance(value, FunctionType):
        if id(value) not in seen:
            seen.add(id(value))
            cells = [cell.cell_contents for cell in value.__closure__ or ()]
            yield from _reached((value.__code__, *cells, value.__defaults__), seen)
            yield from _picked(value.__globals__, _names(value.__code__), seen)
    elif isinstance(value, ModuleType):
        if value.__name__.startswith(PACKAGE):
            yield from _picked(vars(value), names, seen)
    elif isinstance(value, CodeType):
        yield value.co_code
        yield from _reached((value.co_names, value.co_varnames, value.co_consts), seen)
    elif isinstance(value, tuple):
        for item in value:
            yield from _reached(item, seen)
    elif isinstance(value, set | frozenset):
        yield repr(sorted(map(repr, value))).encode()
    elif isinstance(value, np.ndarray):
        yield repr((value.dtype, value.shape)).encode() + value.tobytes()
    elif isinstance(value, type):
        members = list(value) if issubclass(value, Enum) else getattr(value, "_fields", None)
        yield repr((value.__name__, members)).encode()
    else:
        yield repr(value).encode()


def _picked(variables: dict[str, Any], names: Sequence[str], seen: set[int]) -> Iterator[bytes]:
    for name in names:
        if name in variables:
            yield name.encode()
            yield from _reached(variables[name], seen, names)


def _names(code: CodeType) -> list[str]:
    """Return the names of globals and attributes that a code uses, those of functions inside it included."""
    inner = [name for item in code.co_consts if isinstance(item, CodeType) for name in _names(item)]
    return sorted({*code.co_names, *inner})


class _Progress:
    """Tells somebody who waits at a terminal what for: a line on stderr while functions are compiled."""

    def __init__(self) -> None:
        self._count, self._open, self._seconds, self._start = 0, 0, 0.0, 0.0

    def begins(self) -> None:
        """Count a function; those that it calls come before its end."""
        if self._open == 0:
            self._start = time.monotonic()
        self._open, self._count = self._open + 1, self._count + 1
        passed = self._seconds + time.monotonic() - self._start
        self._show(f"{PACKAGE}: compiling, once only, a minute or two: {self._count} functions, {passed:.0f} s")

    def ends(self) -> None:
        """Take the line away after the outermost function."""
        self._open -= 1
        if self._open == 0:
            self._seconds += time.monotonic() - self._start
            self._show("")

    @staticmethod
    def _show(text: str) -> None:
        if sys.stderr.isatty():
            print(f"\r{text}\x1b[K", end="", file=sys.stderr, flush=True)


_PROGRESS = _Progress()


class _KernelCache(FunctionCache):
    """numba's cache, with files named by the hash; where they vanish or cannot be written, the kernel still runs."""

    def __init__(self, kernel: Dispatcher) -> None:
        super().__init__(kernel.py_func)
        function = kernel.py_func
        name = f"{Path(function.__code__.co_filename).stem}.{function.__qualname__}.{sys.implementation.cache_tag}"
        self._kernel, self._stem = kernel, name.replace("<", "").replace(">", "")

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = self._loaded(sig, target_context)
        if found is None:
            _PROGRESS.begins()
        return found

    def _loaded(self, sig: Any, target_context: Any) -> Any:
        stamp = code_hash(self._kernel)
        self._cache_file = IndexDataCacheFile(self.cache_path, f"{self._stem}-{stamp}", stamp)
        with contextlib.suppress(OSError):
            try:
                return super().load_overload(sig, target_context)
            except (AttributeError, EOFError, ImportError, UnpicklingError):
                # Cut off, or a type of an argument has moved to another module, which its code does not tell.
                Path(self._cache_file._index_path).unlink(missing_ok=True)

    def save_overload(self, sig: Any, data: Any) -> None:
        _PROGRESS.ends()
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)
            for file in Path(self.cache_path).glob(f"{self._stem}-{'[0-9a-f]' * DIGITS}.*"):
                if not file.name.startswith(Path(self._cache_file._index_path).stem):
                    file.unlink(missing_ok=True)
