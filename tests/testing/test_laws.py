"""Our own backends keep every law on random robots."""

from __future__ import annotations

from functools import partial

import pytest
from hypothesis import HealthCheck, given, settings

from bodyimage_kin.backends import backends
from bodyimage_kin.testing import LAWS, Case, Law, cases
from bodyimage_kin.testing._library import OurKinematics

# beartype looks at a random item of a tuple; no example depends on it.
pytestmark = pytest.mark.filterwarnings("ignore:Do not use the `random` module inside strategies")

INSTALLED = [name for name, state in backends().items() if state == "installed"]


@pytest.mark.parametrize("backend", INSTALLED)
@pytest.mark.parametrize("law", LAWS.values())
@given(case=cases())
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)
def test_every_backend_keeps_every_law(law: Law, backend: str, case: Case) -> None:
    law(partial(OurKinematics, backend=backend), case)
