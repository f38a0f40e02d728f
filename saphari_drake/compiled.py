"""The ``njit`` of all kernels: numba's, with a cache that sees every edit of what a kernel can reach.

numba takes a cached kernel for fresh as long as the kernel's own file is unchanged. What it calls, and the constants
frozen into it, may lie in other files. Here the folder of cached kernels carries a hash over the text of the kernel's
file and of all files of this package which that imports, directly or through others:

    <the place numba chooses>/<stem of the kernel's file>-<hash>

The place stays numba's choice: ``NUMBA_CACHE_DIR``, ``__pycache__`` beside the file, or the user's cache. Where it
finds none to write to, the place is a folder of the user's among the temporary files; where that cannot be made either,
nothing is cached. When a new folder is made, those of the same file with another hash are removed. Functions compiled
by numba's own ``njit`` are none of this module's business.

A text is read when the first kernel that reaches it is decorated, that of a kernel's own file again when its module is
reloaded: the hash is that of the code in memory, whatever is edited meanwhile.
"""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import os
import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator

PACKAGE = __name__.partition(".")[0]
BASE = Path(__file__).parents[1]
DIGITS = 16  # of the hash, in the folder's name
IMPORT = re.compile(r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+)?import[ \t]+(\([^)]*\)|.*)", re.MULTILINE)


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
            kernel._cache = _KernelCache(function)
        except RuntimeError as error:
            if "cannot cache function" not in str(error):
                raise
    return kernel


def sources_hash(file: str) -> str:
    """Return the hash of the texts of a file and of all files of the package that it imports, directly or not."""
    _read(file, again=True)
    digests: dict[str, bytes] = {}
    waiting = [file]
    while waiting:
        name = waiting.pop()
        if name not in digests:
            source = _read(name)
            digests[name] = source.digest
            waiting += source.imports
    return hashlib.sha256(b"".join(digests[name] for name in sorted(digests))).hexdigest()[:DIGITS]


def imported_files(text: str) -> list[str]:
    """Return the files of the package that a text imports; a name imported from a package may be a module of it."""
    names = set()
    for module, tail in IMPORT.findall(text):
        words = re.findall(r"[\w.]+", tail)
        names |= {module, *(f"{module}.{word}" for word in words)} if module else set(words)
    paths = [BASE.joinpath(*name.split(".")) for name in names if f"{name}.".startswith(f"{PACKAGE}.")]
    files = [file for path in paths for file in (path.with_name(f"{path.name}.py"), path / "__init__.py")]
    return sorted(str(file) for file in files if file.is_file())


class _Source(NamedTuple):
    """Text of a file: when it was changed and its size, its hash, and the files that it imports."""

    stamp: tuple[int, int]
    digest: bytes
    imports: list[str]


_sources: dict[str, _Source] = {}


def _read(file: str, again: bool = False) -> _Source:
    """Return the text of a file as first read, or, if `again`, as it is now."""
    known = _sources.get(file)
    if known is not None and not again:
        return known
    status = os.stat(file)
    stamp = (status.st_mtime_ns, status.st_size)
    if known is None or known.stamp != stamp:
        text = Path(file).read_bytes()
        known = _Source(stamp, hashlib.sha256(text).digest(), imported_files(text.decode()))
        _sources[file] = known
    return known


class _HashedLocator(_CacheLocator):
    """The place that one of numba's locators found, and in it a folder with the hash of the sources."""

    def __init__(self, found: _CacheLocator, file: str) -> None:
        self._py_file = file  # numba's warnings name it
        self._found = found
        self._hash = sources_hash(file)
        self._folder = Path(found.get_cache_path(), f"{Path(file).stem}-{self._hash}")

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._hash

    def get_disambiguator(self) -> str:
        return self._found.get_disambiguator()

    def ensure_cache_path(self) -> None:
        """Make the folder if it is not there, and remove those of earlier sources."""
        if self._folder.is_dir():
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        name = re.compile(rf"{re.escape(self._folder.name[:-DIGITS])}[0-9a-f]{{{DIGITS}}}")
        for folder in self._folder.parent.iterdir():
            if name.fullmatch(folder.name) and folder != self._folder:
                shutil.rmtree(folder, ignore_errors=True)


class _TemporaryLocator(_CacheLocator):
    """A folder of the user's among the temporary files."""

    def __init__(self, function: Callable, file: str) -> None:
        self._line = function.__code__.co_firstlineno
        self._hash = sources_hash(file)
        self._path = os.path.join(_temporary_folder(), self.get_suitable_cache_subpath(file))

    @classmethod
    def from_function(cls, function: Callable, file: str) -> _TemporaryLocator | None:
        try:
            found = cls(function, file)
            found.ensure_cache_path()
        except OSError:
            return None
        return found

    def get_cache_path(self) -> str:
        return self._path

    def get_source_stamp(self) -> str:
        return self._hash

    def get_disambiguator(self) -> str:
        return str(self._line)


def _temporary_folder() -> str:
    """Return a folder that this user alone can write to: what is loaded from it is run."""
    user = os.getuid() if hasattr(os, "getuid") else None
    folder = os.path.join(tempfile.gettempdir(), PACKAGE if user is None else f"{PACKAGE}-{user}")
    os.makedirs(folder, mode=0o700, exist_ok=True)
    status = os.lstat(folder)
    if user is not None and (status.st_uid != user or status.st_mode & 0o077):
        raise PermissionError(f"{folder} is open to others")
    return folder


class _KernelCacheImpl(CompileResultCacheImpl):
    """numba's cache of compiled functions, at the place of this module."""

    _locator_classes: ClassVar = [*CompileResultCacheImpl._locator_classes, _TemporaryLocator]

    def __init__(self, function: Callable) -> None:
        super().__init__(function)
        with contextlib.suppress(OSError):  # typed at a prompt: there is no file to hash
            self._locator: _CacheLocator = _HashedLocator(self._locator, inspect.getfile(function))


class _KernelCache(FunctionCache):
    """A cache whose folder may vanish or be full: the kernel is then compiled, and runs."""

    _impl_class = _KernelCacheImpl

    def load_overload(self, *args: Any) -> Any:
        with contextlib.suppress(OSError):
            return super().load_overload(*args)

    def save_overload(self, *args: Any) -> None:
        with contextlib.suppress(OSError):
            super().save_overload(*args)
