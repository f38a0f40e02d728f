"""Checks shared by the parameter dataclasses; each raises `ParameterError` naming the field."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from saphari_drake.errors import ParameterError, UnknownNameError


def require_positive(params: object, *names: str) -> None:
    """Demand finite numbers > 0 (or arrays of them) in the named fields."""
    for name in names:
        value = np.asarray(getattr(params, name), dtype=float)
        if not (np.all(np.isfinite(value)) and np.all(value > 0.0)):
            raise ParameterError(name, f"must be positive and finite, got {getattr(params, name)}")


def require_non_negative(params: object, *names: str) -> None:
    """Demand finite numbers ≥ 0 (or arrays of them) in the named fields."""
    for name in names:
        value = np.asarray(getattr(params, name), dtype=float)
        if not (np.all(np.isfinite(value)) and np.all(value >= 0.0)):
            raise ParameterError(name, f"must not be negative, got {getattr(params, name)}")


def require_within(params: object, low: float, high: float, *names: str) -> None:
    """Demand numbers (or arrays of them) from `low` to `high` in the named fields."""
    for name in names:
        value = np.asarray(getattr(params, name), dtype=float)
        if not np.all((value >= low) & (value <= high)):
            raise ParameterError(name, f"must lie in {low:g} … {high:g}, got {getattr(params, name)}")


def require_vector(params: object, size: int, *names: str) -> None:
    """Demand `size` finite numbers in the named fields."""
    for name in names:
        value = np.asarray(getattr(params, name), dtype=float)
        if value.shape != (size,) or not np.all(np.isfinite(value)):
            raise ParameterError(name, f"needs {size} finite numbers, got {getattr(params, name)}")


def require_choice(params: object, name: str, choices: tuple[str, ...]) -> None:
    """Demand one of `choices` in the named field."""
    if getattr(params, name) not in choices:
        raise UnknownNameError(name, getattr(params, name), choices)


def share_period(params: Any, *names: str) -> None:
    """Give the period of `params` to the parameters in the named fields.

    Raises
    ------
    ParameterError
        If one of them was given a period of its own: another than its default, or than was shared before.
    """
    before = getattr(params, "_shared_period", params.period)
    for name in names:
        part = getattr(params, name)
        if part.period not in (params.period, before, type(part).period):
            raise ParameterError(f"{name}.period", f"is that of the pipeline, {params.period} s; set period instead")
        part.period = params.period
    params._shared_period = params.period


def diagonal(value: ArrayLike, size: int, name: str) -> NDArray[np.float64]:
    """Spread a scalar gain over `size` entries, or check that a vector has that size.

    Raises
    ------
    ParameterError
        If `value` has another size, or an entry is negative or not finite.
    """
    array = np.asarray(value, dtype=float)
    if array.ndim == 0 or array.shape == (1,):
        array = np.full(size, float(array.reshape(())))
    if array.shape != (size,):
        raise ParameterError(name, f"needs 1 or {size} entries, got shape {array.shape}")
    if not np.all(np.isfinite(array)) or np.any(array < 0.0):
        raise ParameterError(name, f"must not be negative, got {array.tolist()}")
    return array


def positive_definite(value: ArrayLike, size: int, name: str) -> NDArray[np.float64]:
    """Return a symmetric positive definite matrix from a scalar, its diagonal, or the matrix itself.

    Raises
    ------
    ParameterError
        If it has another size, is not symmetric, or has an eigenvalue ≤ 0.
    """
    array = np.asarray(value, dtype=float)
    if array.ndim == 0:
        array = np.full(size, float(array))
    if array.ndim == 1:
        array = np.diag(array)
    if array.shape != (size, size):
        raise ParameterError(name, f"needs shape {(size, size)} or its diagonal, got {np.shape(value)}")
    if not np.all(np.isfinite(array)) or not np.allclose(array, array.T):
        raise ParameterError(name, "must be finite and symmetric")
    if np.linalg.eigvalsh(array)[0] <= 0.0:
        raise ParameterError(name, f"must be positive definite, smallest eigenvalue {np.linalg.eigvalsh(array)[0]:.3g}")
    return array


def validate(params: Any, path: str = "") -> None:
    """Run `__post_init__` of a dataclass and of all it holds, naming the full path of a bad field.

    Loaders that assign fields one by one skip these checks; call this after loading.
    """
    for item in dataclasses.fields(params):
        value = getattr(params, item.name)
        entries = enumerate(value) if isinstance(value, (list, tuple)) else [("", value)]
        for key, entry in entries:
            if dataclasses.is_dataclass(entry):
                validate(entry, f"{path}{item.name}{f'[{key}]' if key != '' else ''}.")
    check = getattr(params, "__post_init__", None)
    if check is None:
        return
    try:
        check()
    except ParameterError as error:
        if not path:
            raise
        raise ParameterError(path + error.field, str(error).removeprefix(f"{error.field}: ")) from error
