"""Figures of skins that are no grid: on the link, laid flat, touches on them, and maps with their graph."""

from __future__ import annotations

import numpy as np
import pytest

import bodyimage_kin as bk
from bodyimage_kin import figures
from bodyimage_kin.errors import InvalidConfig


@pytest.fixture(scope="module")
def patched(body):
    """The infant with half of its taxels, as a skin of points."""
    places, normals = body.skin.link_positions[::2], body.skin.link_normals[::2]
    skin = bk.Skin.points(places, normals, link="head", landmarks={"nose": 110}, reference="nose", eye="nose")
    parts = {"joints": body.joints, "hand": body.hand, "camera": body.camera, "home": body.home}
    return bk.Embodiment.build(body.robot, **parts, skin=skin)


@pytest.fixture(scope="module")
def holed(body):
    """The infant with a grid wider than its face."""
    skin = bk.Skin.grid(
        body.robot, "head", shape=(9, 9), size=(0.144, 0.144), centre=(0.0824, 0.0, 0.06), forward=(1.0, 0.0, 0.0),
        right=(0.0, -1.0, 0.0), landmarks={"nose": (4, 4)}, reference="nose",
    )  # fmt: skip
    parts = {"joints": body.joints, "hand": body.hand, "camera": body.camera, "home": body.home}
    return bk.Embodiment.build(body.robot, **parts, skin=skin)


@pytest.mark.parametrize("flat", [False, True])
def test_touches_stand_on_their_taxels(patched, flat):
    counts = np.arange(patched.skin.count, dtype=float)
    axes = figures.skin(patched, counts, flat=flat, label="touches")
    dots = next(one for one in axes.collections if one.get_array() is not None and len(one.get_array()) > 50)
    shown = np.asarray(dots.get_array())
    assert len(shown) == patched.skin.count
    if flat:
        # Laid flat, what is far apart on the skin is far apart in the plane.
        places = np.asarray(dots.get_offsets())[np.argsort(shown)]
        near, far = patched.skin.neighbours[0], (0, patched.skin.count - 1)
        lengths = [np.linalg.norm(places[one[0]] - places[one[1]]) for one in (near, far)]
        truth = [1000 * patched.skin.spacing * patched.skin.distances[tuple(one)] for one in (near, far)]
        np.testing.assert_allclose(lengths, truth, rtol=0.15)
    figures.skin(patched)  # landmarks and reference, without values


def test_a_map_beside_the_truth_has_its_graph(patched):
    true = patched.hand_image(patched.touch_postures(range(patched.skin.count))).numpy()
    axes = figures.tactile_map(
        0.8 * true, true=true, neighbours=patched.skin.neighbours, landmarks=dict(patched.skin.landmarks)
    )
    segments = [one for one in axes.collections if hasattr(one, "get_segments")]
    drawn = sum(len(one.get_segments()) for one in segments) or sum(len(line.get_xdata()) // 3 for line in axes.lines)
    assert drawn >= len(patched.skin.neighbours)


def test_a_grid_with_holes_leaves_them_blank_and_other_skins_are_no_grid(holed, patched):
    axes = figures.face(holed, np.arange(holed.skin.count))
    image = np.ma.filled(axes.images[0].get_array().astype(float), np.nan)
    np.testing.assert_array_equal(np.isfinite(image), holed.skin.mask)
    with pytest.raises(InvalidConfig, match=r"is no grid; draw it with figures\.skin"):
        figures.face(patched, np.zeros(patched.skin.count))
