"""Checks of parameters: good values pass unchanged, bad ones name their field."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from saphari_drake.errors import ParameterError, SaphariError, UnknownNameError
from saphari_drake.parameters import (
    diagonal,
    positive_definite,
    require_choice,
    require_non_negative,
    require_positive,
    require_vector,
    validate,
)


@dataclass
class Inner:
    gain: list[float] | float = 1.0

    def __post_init__(self):
        require_positive(self, "gain")


@dataclass
class Outer:
    inner: Inner = field(default_factory=Inner)
    many: list[Inner] = field(default_factory=lambda: [Inner(), Inner()])
    offset: float = 0.0
    kind: str = "a"

    def __post_init__(self):
        require_non_negative(self, "offset")
        require_choice(self, "kind", ("a", "b"))


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf, [1.0, 0.0], [1.0, np.nan]])
def test_require_positive(bad):
    with pytest.raises(ParameterError, match="gain: must be positive") as caught:
        Inner(bad)
    assert caught.value.field == "gain"


@pytest.mark.parametrize("good", [1e-9, 3, [1.0, 2.0]])
def test_positive_values_pass(good):
    assert Inner(good).gain == good


@pytest.mark.parametrize("bad", [-1e-9, np.nan, np.inf])
def test_require_non_negative(bad):
    with pytest.raises(ParameterError, match="offset"):
        Outer(offset=bad)
    assert Outer(offset=0.0).offset == 0.0


def test_require_choice_lists_the_choices():
    with pytest.raises(UnknownNameError, match="no kind 'c'; there are: a, b"):
        Outer(kind="c")


@pytest.mark.parametrize("value", [2.0, [2.0], [2.0, 2.0, 2.0], np.full(3, 2)])
def test_diagonal_spreads_a_scalar_and_keeps_a_vector(value):
    np.testing.assert_array_equal(diagonal(value, 3, "K"), [2.0, 2.0, 2.0])


@pytest.mark.parametrize("bad", [[1.0, 2.0], [], np.eye(3), -1.0, [1.0, 1.0, -1.0], np.nan, np.inf])
def test_bad_diagonal(bad):
    with pytest.raises(ParameterError, match=r"^K: "):
        diagonal(bad, 3, "K")


@pytest.mark.parametrize(
    ("value", "expected"),
    [(2.0, 2 * np.eye(3)), ([1.0, 2.0, 3.0], np.diag([1.0, 2.0, 3.0])), (np.eye(3) + 0.1, np.eye(3) + 0.1)],
)
def test_positive_definite_from_scalar_diagonal_or_matrix(value, expected):
    np.testing.assert_array_equal(positive_definite(value, 3, "M"), expected)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ([1.0, 0.0, 1.0], "positive definite"),
        (-np.eye(3), "positive definite"),
        (np.eye(3) + 2.0 * (1 - np.eye(3)), "positive definite"),
        (np.triu(np.ones((3, 3))), "symmetric"),
        (np.full(3, np.nan), "finite"),
        ([1.0, 2.0], "shape"),
        (np.eye(2), "shape"),
    ],
)
def test_not_positive_definite(bad, message):
    with pytest.raises(ParameterError, match=f"^M: .*{message}"):
        positive_definite(bad, 3, "M")


def test_validate_names_the_path_of_a_field_that_was_assigned_later():
    """Loaders assign fields one by one, behind the constructor's back."""
    params = Outer()
    validate(params)
    params.inner.gain = -1.0
    with pytest.raises(ParameterError, match=r"^inner\.gain: must be positive") as caught:
        validate(params)
    assert caught.value.field == "inner.gain"
    params.inner.gain, params.many[1].gain = 1.0, 0.0
    with pytest.raises(ParameterError, match=r"^many\[1\]\.gain: "):
        validate(params)


def test_errors_are_of_one_family_and_of_pythons():
    """A caller can catch all of them by the base, or by what Python would have raised."""
    assert issubclass(ParameterError, (SaphariError, ValueError))
    assert issubclass(UnknownNameError, KeyError)
    assert str(UnknownNameError("frame", "ee", ())) == "no frame 'ee'; there are: none"


@pytest.mark.parametrize("value", [[1.0, 2.0], [1.0, 2.0, np.nan], 1.0, [[1.0, 2.0, 3.0]]])
def test_a_vector_has_its_size_and_finite_numbers(value):
    require_vector(SimpleNamespace(p=[1.0, 2.0, 3.0]), 3, "p")
    with pytest.raises(ParameterError, match="p: needs 3 finite numbers"):
        require_vector(SimpleNamespace(p=value), 3, "p")
