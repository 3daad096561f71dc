"""What many tests share: the infant, one small recording of each motion, and where real recordings lie."""

import os
from pathlib import Path

import jaxtyping
import pytest
import torch
from hypothesis import settings

import bodyimage_kin as bk

settings.register_profile("bodyimage_kin", deadline=None, print_blob=True)
settings.load_profile("bodyimage_kin")
torch.set_num_threads(1)

DATA = "BODYIMAGE_KIN_DATA"


def pytest_collection_modifyitems(items):
    """Marks whatever takes the folder of real recordings."""
    for item in items:
        if "real_data" in getattr(item, "fixturenames", ()):
            item.add_marker("real_data")


@pytest.fixture(scope="session")
def real_data():
    """The folder of real recordings, which are not shipped; tests that take it are marked ``real_data``."""
    folder = os.environ.get(DATA)
    if not folder:
        pytest.skip(f"no real recordings here: {DATA} is not set to a folder that holds them")
    if not Path(folder).is_dir():
        pytest.skip(f"no real recordings here: {DATA}={folder} is no folder")
    return Path(folder).absolute()


@pytest.fixture
def unchecked(monkeypatch):
    """What a user meets who gives the wrong type: our own errors, without the tests' checks of types before them."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


@pytest.fixture(scope="session")
def body():
    return bk.load_embodiment("infant")


@pytest.fixture(scope="session")
def circle(body):
    return bk.simulate(body, bk.motions.Circle(turns=1.0), seed=1, dynamics=False)


@pytest.fixture(scope="session")
def tour(body):
    return bk.simulate(body, bk.motions.FaceTour(), seed=1, dynamics=False)


@pytest.fixture(scope="session")
def touch(body):
    return bk.simulate(body, bk.motions.RandomTouch(duration=30.0), seed=1, dynamics=False)
