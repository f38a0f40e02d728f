"""The cache of kernels: it sees edits in other files, is used when nothing changed, and finds a place anywhere."""

import ast
import os
import pickle
import shutil
import subprocess
import sys
from enum import IntEnum
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.caching import CompileResultCacheImpl, FunctionCache

import saphari_drake
from saphari_drake import compiled
from saphari_drake.math.curves import quintic

PACKAGE = Path(saphari_drake.__file__).parent
FILES = {
    "__init__.py": "",
    "numbers/__init__.py": "",
    "numbers/factor.py": "FACTOR = 2.0\n",
    "inner.py": """
from saphari_drake.compiled import njit
from saphari_drake.numbers import factor

FACTOR = factor.FACTOR


@njit
def scaled(x):
    return FACTOR * x
""",
    "outer.py": """
from saphari_drake.compiled import njit
from saphari_drake.inner import (
    scaled,
)


@njit(cache=True)
def shifted(x):
    return scaled(x) + 1.0
""",
    "alone.py": """
from saphari_drake.compiled import njit


@njit
def same(x):
    return x
""",
}
CALL = """
from saphari_drake.alone import same
from saphari_drake.outer import shifted
print(shifted(3.0), sum(shifted.stats.cache_hits.values()), same(1.0), sum(same.stats.cache_hits.values()))
"""


@pytest.fixture
def small(tmp_path):
    """A package of three kernels, one of which calls another that holds a constant of a third file."""
    folder = tmp_path / "saphari_drake"
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    shutil.copy(PACKAGE / "compiled.py", folder)
    return folder


def call(small, program=CALL, **environment):
    """Run a program in a process of its own; return the numbers it prints."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA")}
    kept |= {"PYTHONPATH": str(small.parent), "PYTHONDONTWRITEBYTECODE": "1"} | environment
    done = subprocess.run([sys.executable, "-c", program], env=kept, capture_output=True, text=True, cwd=small.parent)
    assert done.returncode == 0, done.stderr
    return [float(word) for word in done.stdout.split()]


def edit(small, name, old, new):
    path = small / name
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


def saved(place, stem):
    """Return the names of the cached files of a module's kernel, without their ends."""
    return sorted({path.name.split(".", 3)[2] for path in place.glob(f"{stem}.*.nb[ci]")})


def test_nothing_edited_nothing_compiled(small):
    """The second process takes both kernels from the cache."""
    assert call(small) == [7.0, 0, 1.0, 0]
    assert call(small) == [7.0, 1, 1.0, 1]


@pytest.mark.parametrize(
    ("name", "old", "new", "result"),
    [
        ("inner.py", "FACTOR * x", "FACTOR * x * x", 19.0),
        ("numbers/factor.py", "2.0", "4.0", 13.0),
        ("outer.py", "+ 1.0", "+ 2.0", 8.0),
    ],
)
def test_an_edit_in_another_file_is_seen(small, name, old, new, result):
    """A callee, or a constant two files away, counts at once; what does not reach it stays cached; old files go."""
    call(small)
    place = small / "__pycache__"
    before, alone = saved(place, "outer"), saved(place, "alone")
    edit(small, name, old, new)
    assert call(small) == [result, 0, 1.0, 1]
    after = saved(place, "outer")
    assert len(before) == len(after) == 1 and before != after
    assert saved(place, "alone") == alone and len(alone) == 1
    assert call(small) == [result, 1, 1.0, 1]


def test_an_edit_while_a_process_runs_is_seen_by_the_next(small):
    """Code compiled from the old text is not kept under the new text's hash."""
    program = f"""
from saphari_drake.inner import scaled
path = {str(small / "inner.py")!r}
text = open(path).read()
open(path, "w").write(text.replace("FACTOR * x", "FACTOR * x * x"))
from saphari_drake.outer import shifted
print(shifted(3.0))
"""
    assert call(small, program) == [7.0]
    assert call(small)[0] == 19.0


def test_a_reloaded_module_is_that_of_its_new_text(small):
    """Kernels of a module reloaded after an edit, and of one that imports it, are not kept under the old hash."""
    program = f"""
import importlib
from saphari_drake import inner, outer
path = {str(small / "inner.py")!r}
text = open(path).read()
open(path, "w").write(text.replace("FACTOR * x", "FACTOR * x * x"))
importlib.reload(inner), importlib.reload(outer)
print(outer.shifted(3.0))
"""
    assert call(small, program) == [19.0]
    assert call(small)[:2] == [19.0, 1]
    edit(small, "inner.py", "FACTOR * x * x", "FACTOR * x")
    assert call(small)[:2] == [7.0, 0]


def test_numba_cache_dir_is_kept_to(small, tmp_path):
    place = tmp_path / "elsewhere"
    for hits in (0, 1):
        assert call(small, NUMBA_CACHE_DIR=str(place)) == [7.0, hits, 1.0, hits]
    assert len(list(place.glob("*/outer.*.nbc"))) == 1
    assert not (small / "__pycache__").exists()


def test_without_a_place_to_write_kernels_run_uncached(small):
    """An installation that is read-only, and no home; it holds for the superuser too."""
    (small / "__pycache__").write_text("a file, not a folder")
    for _ in range(2):
        assert call(small, HOME=os.devnull, XDG_CACHE_HOME=os.devnull) == [7.0, 0, 1.0, 0]


def test_a_kernel_whose_files_cannot_be_written_runs(small):
    """The place was writable when the kernel was made, and is gone when it is compiled."""
    program = f"""
import shutil
from saphari_drake.outer import shifted
place = {str(small / "__pycache__")!r}
shutil.rmtree(place, ignore_errors=True)
open(place, "w").close()
print(shifted(3.0))
"""
    assert call(small, program) == [7.0]


@pytest.mark.parametrize("spoilt", [b"", b"\x80\x05cnowhere\nTable\n.", b"no pickle"])
def test_a_spoilt_index_is_made_anew(small, spoilt):
    """One that is cut off, or names a type that has moved."""
    call(small)
    (index,) = (small / "__pycache__").glob("outer.*.nbi")
    index.write_bytes((pickle.dumps(numba.__version__) if spoilt else b"") + spoilt)
    assert call(small)[:2] == [7.0, 0]
    assert call(small)[:2] == [7.0, 1]


def test_functions_of_others_keep_numbas_cache(tmp_path, monkeypatch):
    """numba's own njit is untouched."""
    (tmp_path / "theirs.py").write_text("from numba import njit\n\n@njit(cache=True)\ndef f(x):\n    return x\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    import theirs

    assert type(theirs.f._cache) is FunctionCache
    assert type(theirs.f._cache._impl.locator).__module__ == "numba.core.caching"  # whichever place it chose
    assert all(cls.__module__ == "numba.core.caching" for cls in CompileResultCacheImpl._locator_classes)


def test_options_are_numbas():
    """``error_model``, ``fastmath``, no cache, and kernels that are pickled."""

    def inverse(x):
        return 1.0 / x

    assert compiled.njit(error_model="numpy", cache=False)(inverse)(0.0) == np.inf
    with pytest.raises(ZeroDivisionError):
        compiled.njit(cache=False)(inverse)(0.0)
    assert compiled.njit(fastmath={"contract"}, cache=False)(inverse).targetoptions["fastmath"] == {"contract"}
    assert compiled.njit(cache=False)(inverse).stats.cache_path is None
    assert pickle.loads(pickle.dumps(quintic))(0.5)[0] == pytest.approx(0.5)


def test_without_compiling_functions_stay_python(small):
    assert call(small, "from saphari_drake.outer import shifted; print(shifted(3))", NUMBA_DISABLE_JIT="1") == [7.0]


def test_a_terminal_is_told_while_functions_are_compiled(small):
    """The line counts them and is gone at the end; with everything cached there is none."""
    program = """
import io, sys
class Terminal(io.StringIO):
    isatty = lambda self: True
sys.stderr = terminal = Terminal()
from saphari_drake.outer import shifted
shifted(3.0)
text = terminal.getvalue()
print(text.count("compiling"), float("2 functions" in text), float(text.endswith("\\r\\x1b[K")))
"""
    assert call(small, program) == [2.0, 1.0, 1.0]
    assert call(small, program) == [0.0, 0.0, 0.0]


def test_misnamed_locators_are_told(small):
    """A wrong setting of numba's is an error, not a cache that is missing."""
    program = """
try:
    import saphari_drake.outer
except RuntimeError as error:
    print(float("nowhere.Locator" in str(error)))
"""
    if "CACHE_LOCATOR_CLASSES" not in dir(numba.core.config):
        pytest.skip("this numba has no such setting")
    assert call(small, program, NUMBA_CACHE_LOCATOR_CLASSES="nowhere.Locator") == [1.0]


def hashes(edits=()):
    """Return the hash of a kernel that refers to all sorts of things, with some of them replaced."""
    names = {"np": np, "FACTOR": 2.0, "TABLE": np.arange(3.0), "Kind": IntEnum("Kind", {"A": 1, "B": 2})}
    text = """
def inner(x):
    return FACTOR * x

def kernel(x, kind, scale=1.0):
    '''About it.'''  # comment
    total = np.sqrt(x)
    for k in range(3):
        total += inner(x) * TABLE[k] if kind == Kind.A else scale
    return total
"""
    options = {}
    for old, new in edits:
        if isinstance(old, str) and old in names:
            names[old] = new
        elif old == "options":
            options = new
        else:
            assert old in text
            text = text.replace(old, new)
    exec(text, names)
    names["inner"] = compiled.njit(cache=False)(names["inner"])
    return compiled.code_hash(compiled.njit(cache=False, **options)(names["kernel"]))


def test_the_hash_is_that_of_all_a_kernel_can_reach():
    """Code, callees, constants, tables, enums, defaults and options count; comments and lines do not."""
    base = hashes()
    assert hashes([("# comment", "# other\n")]) == hashes([("def inner", "\n\n\ndef inner")]) == base == hashes()
    edits = [
        ("FACTOR * x", "FACTOR + x"), ("FACTOR", 3.0), ("TABLE", np.arange(3.0) + 1e-16), ("TABLE", np.arange(3)),
        ("Kind", IntEnum("Kind", {"A": 2, "B": 1})), ("scale=1.0", "scale=2.0"), ("options", {"fastmath": True}),
        ("np.sqrt", "np.cbrt"), ("range(3)", "range(2)"), ("inner(x) *", "x *"),
    ]  # fmt: skip
    found = [hashes([edit]) for edit in edits]
    assert len({base, *found}) == len(edits) + 1


def test_hashes_are_the_same_in_every_process():
    """No address, and no order of a set, enters: all kernels that import here hash alike under two seeds."""
    program = """
import importlib, pkgutil, numba, saphari_drake
from saphari_drake.compiled import code_hash
for package in ("math", "control.null_space", "control.reverse_priority", "perception.contact"):
    folder = importlib.import_module(f"saphari_drake.{package}")
    for info in pkgutil.iter_modules(folder.__path__):
        module = importlib.import_module(f"{folder.__name__}.{info.name}")
        for name, value in sorted(vars(module).items()):
            if isinstance(value, numba.core.dispatcher.Dispatcher):
                print(module.__name__, name, code_hash(value))
"""
    runs = []
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONPATH": str(PACKAGE.parent), "PYTHONHASHSEED": seed}
        done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        runs.append(done.stdout)
    assert runs[0] == runs[1] and len(runs[0].splitlines()) > 50


def test_all_kernels_use_this_cache():
    """Nothing else in the package takes a compiler from numba."""
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            taken = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            taken += [node.module] if isinstance(node, ast.ImportFrom) else []
            numbas = [name for name in taken if name.split(".")[0] == "numba"]
            assert not numbas or path.name == "compiled.py", f"{path} imports {numbas}"
