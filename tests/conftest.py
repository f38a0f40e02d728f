"""Fixtures that several test files share."""

import pytest
from arms import FIXED, TILTED, arm_path
from hypothesis import settings

from saphari_drake.robots import catalog
from saphari_drake.robots.model import RobotModel

# A first call may compile.
settings.register_profile("compiled", deadline=None, derandomize=True)
settings.load_profile("compiled")


@pytest.fixture(scope="session")
def lwr4():
    return catalog.lwr4()


@pytest.fixture(scope="session")
def load_arm(tmp_path_factory):
    """Loader of the arms of `arms.ARMS`, each read once, on a tilted base where the file leaves that free."""
    folder, loaded = tmp_path_factory.mktemp("arms"), {}

    def load(name):
        if name not in loaded:
            loaded[name] = RobotModel(arm_path(name, folder), X_WB=None if name in FIXED else TILTED)
        return loaded[name]

    return load
