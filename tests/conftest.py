"""What many tests share: the infant, and one small recording of each motion."""

import pytest
import torch
from hypothesis import settings

import bodyimage_kin as bk

settings.register_profile("bodyimage_kin", deadline=None, print_blob=True)
settings.load_profile("bodyimage_kin")
torch.set_num_threads(1)


@pytest.fixture(scope="session")
def body():
    return bk.load_embodiment("infant")


@pytest.fixture(scope="session")
def circle(body):
    return bk.simulate.circle(body, dynamics=False, turns=1.0, seed=1)


@pytest.fixture(scope="session")
def tour(body):
    return bk.simulate.face_tour(body, dynamics=False, seed=1)


@pytest.fixture(scope="session")
def touch(body):
    return bk.simulate.random_touch(body, dynamics=False, duration=30.0, seed=1)
