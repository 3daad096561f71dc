"""Every backend and the oracle agree on pose, Jacobian and hessian, to 1e-10 of the scale.

``pytest -m slow tests/testing/test_agreement.py`` asks it of 2,000 robots at three postures each.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import bodyimage_kin as bk
from bodyimage_kin.backends import backends
from bodyimage_kin.testing import Case, oracle, postures, robots

pytestmark = pytest.mark.filterwarnings("ignore:Do not use the `random` module inside strategies")

INSTALLED = [name for name, state in backends().items() if state == "installed"]
ALLOWED = 1e-10


@pytest.mark.parametrize("examples", [15, pytest.param(2000, marks=pytest.mark.slow)])
def test_backends_and_oracle_agree(examples: int) -> None:
    seen, worst, where = 0, 0.0, ""

    @settings(
        max_examples=examples,
        deadline=None,
        database=None,
        derandomize=True,
        suppress_health_check=list(HealthCheck),
        phases=[Phase.generate, Phase.shrink],
    )
    @given(robot=robots(min_joints=1), data=st.data())
    def check(robot: Any, data: st.DataObject) -> None:
        nonlocal seen, worst, where
        seen += 1
        read = bk.Robot.from_urdf(robot.to_urdf())
        libraries = {name: bk.kinematics(read, name) for name in INSTALLED}
        for _ in range(3):
            q = data.draw(postures(robot))
            for link in robot.links:
                case = Case(robot, q, link)
                truth = oracle(case)
                scales = (case.scale, case.scale * case.gain, case.scale * case.gain**2)
                for name, library in libraries.items():
                    found = (*library.pose_and_jacobian(case.posture, link), library.hessian(case.posture, link))
                    errors = [np.abs(a.numpy() - b).max(initial=0.0) for a, b in zip(found, truth, strict=True)]
                    error = max(error / scale for error, scale in zip(errors, scales, strict=True))
                    assert error <= ALLOWED, f"{name} is {error:.1e} from the oracle at {link!r}\n{case.to_urdf()}"
                    if error > worst:
                        worst, where = error, f"{name}, at\n{case.to_urdf()}"

    check()
    assert seen >= examples
    print(f"{seen} robots x 3 postures x every link, {', '.join(INSTALLED)} and the oracle")
    print(f"worst error {worst:.1e} by {where}")
