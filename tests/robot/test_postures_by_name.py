"""A posture by name is a new one: what it is based on stays as it was."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from robots import tricky


@pytest.mark.parametrize("base", [torch.full((4,), 0.25, dtype=torch.float64), np.full(4, 0.25)])
def test_the_base_of_a_posture_is_left_as_it_was(base: torch.Tensor | np.ndarray) -> None:
    robot = tricky()
    assert robot.n == 4
    found = robot.posture({"base": 0.5}, base=base)
    assert robot.named(found) == {"zulu": 0.25, "slide": 0.25, "base": 0.5, "alpha": 0.25}
    assert np.asarray(base).tolist() == [0.25] * 4
