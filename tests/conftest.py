"""What many tests share: the infant, and one small recording of each motion."""

import jaxtyping
import pytest
import torch
from hypothesis import settings

import bodyimage_kin as bk

settings.register_profile("bodyimage_kin", deadline=None, print_blob=True)
settings.load_profile("bodyimage_kin")
torch.set_num_threads(1)


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
