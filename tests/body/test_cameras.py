"""Laws of cameras: the virtual screen by hand, and every model against its derivatives."""

import math

import pytest
import torch

from bodyimage_kin.body.cameras import VirtualScreen

SCREEN = VirtualScreen(distance=0.04, near=0.05, half_angle=math.radians(60))


def tensor(*values):
    return torch.tensor(values, dtype=torch.float64)


def test_a_point_is_seen_at_screen_distance_times_its_slope():
    # x = h_z h_x / z and y = h_z h_y / z (equations 18 and 19).
    image = SCREEN.project(tensor([0.02, -0.03, 0.08], [0.02, -0.03, 0.04], [0.0, 0.0, 1.0]))
    torch.testing.assert_close(image, tensor([0.01, -0.015], [0.02, -0.03], [0.0, 0.0]), atol=1e-17, rtol=0)


def test_what_is_not_in_front_has_no_image():
    image = SCREEN.project(tensor([0.1, 0.1, 0.0], [0.1, 0.1, -1.0], [0.1, 0.1, 1e-9]))
    assert image.isnan().all(1).tolist() == [True, True, False]


def test_a_point_without_image_spoils_no_gradient():
    points = tensor([0.1, 0.1, -1.0], [0.01, 0.0, 0.1]).requires_grad_()
    SCREEN.project(points)[1].sum().backward()
    assert torch.isfinite(points.grad).all()


@pytest.mark.parametrize("batch", [(), (0,), (2, 3)])
def test_the_derivative_is_that_of_the_projection(batch):
    points = torch.rand(*batch, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)) + 0.05
    derivative = SCREEN.derivative(points)
    assert derivative.shape == (*batch, 2, 3)
    for point, expected in zip(points.reshape(-1, 3), derivative.reshape(-1, 2, 3), strict=True):
        torch.testing.assert_close(torch.func.jacrev(SCREEN.project)(point), expected, atol=1e-14, rtol=1e-14)


def test_the_derivative_by_hand():
    # h_z / z [[1, 0, -x/z], [0, 1, -y/z]] at z = 0.08.
    derivative = SCREEN.derivative(tensor(0.02, -0.04, 0.08))
    torch.testing.assert_close(derivative, tensor([0.5, 0.0, -0.125], [0.0, 0.5, 0.25]), atol=1e-16, rtol=0)


def test_the_view_is_a_cone_beyond_the_near_plane():
    inside = math.tan(math.radians(59.9)) * 0.1
    outside = math.tan(math.radians(60.1)) * 0.1
    seen = {
        (0.0, 0.0, 0.05): True,
        (0.0, 0.0, 0.0499): False,
        (0.0, 0.0, -0.1): False,
        (inside, 0.0, 0.1): True,
        (0.0, -inside, 0.1): True,
        (outside, 0.0, 0.1): False,
        # A cone, not a pyramid: each coordinate alone would pass.
        (0.8 * inside, 0.8 * inside, 0.1): False,
        (0.0, 0.0, math.nan): False,
    }
    assert SCREEN.visible(tensor(*seen)).tolist() == list(seen.values())
