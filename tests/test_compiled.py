"""The cache of kernels: it sees edits in other files, is used when nothing changed, and finds a place anywhere."""

import ast
import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.caching import CompileResultCacheImpl, FunctionCache

import saphari_drake
from saphari_drake import compiled
from saphari_drake.control.reverse_priority.activation import quintic

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


def folders(place, stem):
    return sorted(path.name for path in place.glob(f"{stem}-*"))


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
    """A callee, or a constant two files away, counts at once; what does not reach it stays cached; old folders go."""
    call(small)
    place = small / "__pycache__"
    before, alone = folders(place, "outer"), folders(place, "alone")
    edit(small, name, old, new)
    assert call(small) == [result, 0, 1.0, 1]
    after = folders(place, "outer")
    assert len(before) == len(after) == 1 and before != after
    assert folders(place, "alone") == alone and len(alone) == 1
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
    assert len(list(place.glob("*/outer-*/*.nbc"))) == 1
    assert not (small / "__pycache__").exists()


def nowhere(small, tmp_path):
    """Return an environment in which numba finds no place; it holds for the superuser too."""
    (small / "__pycache__").write_text("a file, not a folder")
    (tmp_path / "temporary").mkdir()
    return {"HOME": os.devnull, "XDG_CACHE_HOME": os.devnull, "TMPDIR": str(tmp_path / "temporary")}


def test_without_a_place_to_write_the_temporary_folder_serves(small, tmp_path):
    """An installation that is read-only, and no home: cached all the same, for nobody else to write to."""
    environment = nowhere(small, tmp_path)
    for hits in (0, 1):
        assert call(small, **environment) == [7.0, hits, 1.0, hits]
    (own,) = (tmp_path / "temporary").glob("saphari_drake*")
    assert own.stat().st_mode & 0o077 == 0 and len(list(own.glob("*/outer-*/*.nbc"))) == 1


def test_a_folder_open_to_others_is_not_used(small, tmp_path):
    """What another user may have put there would be run: compile anew instead."""
    environment = nowhere(small, tmp_path)
    own = tmp_path / "temporary" / f"saphari_drake-{os.getuid()}"
    own.mkdir()
    own.chmod(0o777)
    for _ in range(2):
        assert call(small, **environment) == [7.0, 0, 1.0, 0]
    assert not any(own.iterdir())


def test_a_kernel_whose_folder_cannot_be_made_runs(small):
    """The place was writable when the kernel was made, and its folder's name is taken by a file."""
    call(small)
    place = small / "__pycache__"
    for stem in ("outer", "alone"):
        (name,) = folders(place, stem)
        shutil.rmtree(place / name)
        (place / name).write_text("")
    assert call(small) == [7.0, 0, 1.0, 0]


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
    assert pickle.loads(pickle.dumps(quintic))(0.5) == pytest.approx(0.5)


def test_without_compiling_functions_stay_python(small):
    assert call(small, "from saphari_drake.outer import shifted; print(shifted(3))", NUMBA_DISABLE_JIT="1") == [7.0]


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


# ---- the package ----------------------------------------------------------------------------------------------------


def modules(tree):
    """Return the modules that a syntax tree may import: of ``from a import b`` both ``a`` and ``a.b``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_imports_read_from_the_text_are_all_there_are():
    """The files found in the text of every module are those that its syntax tree imports."""
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text()
        expected = set()
        for name in modules(ast.parse(text)):
            file = PACKAGE.parent.joinpath(*name.split("."))
            if name.split(".")[0] == "saphari_drake":
                found = (file.with_suffix(".py"), file / "__init__.py")
                expected |= {str(candidate) for candidate in found if candidate.is_file()}
        assert set(compiled.imported_files(text)) == expected, path


def test_all_kernels_use_this_cache():
    """Nothing else in the package takes a compiler from numba."""
    for path in PACKAGE.rglob("*.py"):
        taken = [name for name in modules(ast.parse(path.read_text())) if name.split(".")[0] == "numba"]
        assert not taken or path.name == "compiled.py", f"{path} imports {taken}"
