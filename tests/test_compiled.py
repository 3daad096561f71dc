"""Laws of how functions are compiled, and of the arithmetic of reaching."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import pytest
import torch

from bodyimage_kin import _compiled
from bodyimage_kin.body import reach


def test_functions_compile_where_nothing_can_be_cached(monkeypatch: pytest.MonkeyPatch) -> None:
    real = _compiled.njit

    def njit(*, cache: bool = False, **options: object) -> object:
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return real(**options)

    monkeypatch.setattr(_compiled, "njit", njit)
    assert _compiled.compiled(abs_of)(-2.0) == 2.0


def abs_of(x: float) -> float:
    return abs(x)


def test_functions_of_others_compile_as_ever() -> None:
    scope: dict[str, Any] = {}
    exec("def twice(x):\n    return 2 * x", {"__name__": None}, scope)
    assert numba.njit(scope["twice"])(3.0) == 6.0


@pytest.mark.parametrize("threads", [1, 3])
def test_work_in_threads_comes_back_in_order(threads: int) -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        assert list(_compiled.in_threads(abs_of, [-3.0, 1.0, -2.0])) == [3.0, 1.0, 2.0]
        assert list(_compiled.in_threads(abs_of, [])) == []
    finally:
        torch.set_num_threads(before)


def problems(seed: int) -> tuple[torch.Tensor, ...]:
    draw = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(shape, generator=draw, dtype=torch.float64)

    count, p = 50, 5
    return normal(count, 3, p), 0.05 * normal(count, 3), 0.05 * normal(count, p), 0.1 * normal(count, p)


def test_a_step_within_limits_is_the_one_of_least_displacement() -> None:
    jacobian, error, pull, q = problems(0)
    wide = torch.full((5,), 10.0, dtype=torch.float64)
    inverse = torch.linalg.pinv(jacobian)
    change = pull[..., None] + inverse @ (error[..., None] - jacobian @ pull[..., None])
    length = change.norm(dim=1, keepdim=True)
    expected = q + (change * (0.5 / length).clamp(max=1.0))[..., 0]
    torch.testing.assert_close(reach.step(jacobian, error, pull, q, -wide, wide), expected, atol=1e-9, rtol=0)


def test_a_step_too_long_to_be_trusted_is_cut_down_and_keeps_its_direction() -> None:
    jacobian, error, pull, q = problems(3)
    wide = torch.full((5,), 1e3, dtype=torch.float64)
    far, still = 100.0 * error, torch.zeros_like(pull)
    moved = reach.step(jacobian, far, still, q, -wide, wide) - q
    whole = (torch.linalg.pinv(jacobian) @ far[..., None])[..., 0]
    assert bool((whole.norm(dim=1) > 0.5).all())
    torch.testing.assert_close(moved, 0.5 * whole / whole.norm(dim=1, keepdim=True), atol=1e-9, rtol=0)


def test_joints_at_a_limit_stay_there_and_the_others_close_the_error() -> None:
    jacobian, error, pull, q = problems(1)
    lower, upper = torch.full((5,), -10.0).double(), torch.full((5,), 10.0).double()
    # The first joint is at a limit that it is asked to pass.
    free = reach.step(jacobian, error, pull, q, lower, upper)
    lower[0], q[:, 0] = q[:, 0].max() + 0.1, q[:, 0].max() + 0.1
    after = reach.step(jacobian, error, pull, q, lower, upper)
    assert bool((after >= lower).all())
    held = after[:, 0] == lower[0]
    assert bool(held.any())
    assert bool((~held).any())
    small = (after - q).norm(dim=1) < 0.49
    moved = (jacobian @ (after - q)[..., None])[..., 0]
    torch.testing.assert_close(moved[small], error[small], atol=1e-9, rtol=0)
    assert not torch.equal(free, after)


def test_a_point_that_no_joint_moves_leaves_the_posture_finite() -> None:
    jacobian, error, pull, q = problems(2)
    limit = torch.full((5,), 10.0, dtype=torch.float64)
    after = reach.step(0 * jacobian, error, pull, q, -limit, limit)
    assert bool(np.isfinite(after.numpy()).all())
