"""Every figure shows what it promises: panels, units, names, every curve where its numbers say, nothing cut off."""

import numpy as np
import pytest
import xarray
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb

from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.figures import figures, style

RNG = np.random.default_rng(0)
PATH = np.cumsum(RNG.normal(0, 1e-3, (60, 2)), 0)
TIME = np.arange(60) * 0.1
LANDMARKS = {"left_eye": (0.01, -0.01), "mouth": (0.0, 0.03)}
GRID = np.stack(np.meshgrid(np.linspace(-0.03, 0.03, 7), np.linspace(-0.02, 0.02, 5)), -1)
MAPS = np.stack([GRID * scale for scale in (0.2, 0.6, 1.0)])
STEPS = [0, 100, 200]
ROBOT = """<robot name="r"><link name="base">
  <visual><geometry><cylinder radius="0.05" length="0.3"/></geometry></visual>
  <visual><origin xyz="0 0 0.25"/><geometry><sphere radius="0.08"/></geometry></visual></link></robot>"""
ANGLES = np.stack(np.meshgrid(np.linspace(-0.4, 0.4, 5), np.linspace(0.4, -0.4, 5)), -1).reshape(-1, 2)
TAXELS = [0, 0, 0.25] + 0.08 * np.stack(
    [np.cos(ANGLES).prod(1), np.sin(ANGLES[:, 0]) * np.cos(ANGLES[:, 1]), np.sin(ANGLES[:, 1])], 1
)
TURN = np.linspace(0, 6.3, 50)
CIRCLE = np.stack([np.full(50, 0.12), 0.05 * np.cos(TURN), 0.25 + 0.05 * np.sin(TURN)], 1)
MADE = {
    "velocities": lambda: figures.velocities(TIME, PATH, {"PaperMLP": PATH * 2, "analytic": PATH}),
    "conditions": lambda: figures.velocities(
        TIME, np.stack([PATH, PATH]), {"paper_mlp": np.stack([PATH, PATH * 2])}, conditions=["quiet", "noisy"]
    ),
    "trajectories": lambda: figures.trajectories(PATH, {"paper_mlp": PATH * 0.5}, LANDMARKS),
    "maps": lambda: figures.map_snapshots(
        {"paper_mlp": MAPS * 0.5, "direct": MAPS}, STEPS, {"nose": 17, "mouth": 31}, true_map=GRID
    ),
    "one_map": lambda: figures.map_snapshots(MAPS, STEPS),
    "topological": lambda: figures.topological_error(
        STEPS, {"direct": [[9, 5, 1], [7, 3, 1]]}, spans={"direct": [[0, 0.5, 0.6]]}, chance=8
    ),
    "distance": lambda: figures.error_by_distance(
        {"on_circle": TIME, "on_face": TIME + 3},
        {
            "least_squares": {"on_circle": 0.1 + TIME, "on_face": np.stack([0.5 + TIME, 0.5 + TIME])},
            "other": {"on_face": TIME + 1},
        },
    ),
    "face": lambda: figures.touching_face(ROBOT, {}, TAXELS, {"nose": 12}, CIRCLE),
    "body": lambda: figures.touching_face(ROBOT, {}, TAXELS, close_up=False),
}


def line(axes, name):
    return next(found for found in axes.get_lines() if found.get_label() == name)


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


@pytest.mark.parametrize("name", MADE)
def test_figures_are_reproducible_small_and_whole(tmp_path, name):
    figure = MADE[name]()
    first, again, anew = (
        style.save(made, tmp_path, f"{name}{index}") for index, made in enumerate([figure, figure, MADE[name]()])
    )
    for kind in range(2):
        assert first[kind].read_bytes() == again[kind].read_bytes() == anew[kind].read_bytes()
    assert first[0].stat().st_size < 300_000
    assert figure.get_figwidth() in (pytest.approx(88 / 25.4), pytest.approx(180 / 25.4)) or "map" in name
    drawn = figure.get_tightbbox().get_points()
    assert (drawn >= -0.02).all(), "something is cut off"
    assert (drawn <= figure.get_size_inches() + 0.02).all(), "something is cut off"
    if name not in ("face", "body"):
        assert all(axes.get_ylabel() or axes.get_shared_y_axes() for axes in figure.axes)


def test_velocities_are_in_millimetres_and_truth_is_black():
    figure = MADE["velocities"]()
    x, y = figure.axes
    np.testing.assert_allclose(line(x, "truth").get_ydata(), PATH[:, 0] * 1000)
    np.testing.assert_allclose(line(y, "paper's network").get_ydata(), PATH[:, 1] * 2000)
    assert to_rgb(line(x, "truth").get_color()) == (0, 0, 0)
    assert (x.get_ylabel(), y.get_ylabel(), y.get_xlabel()) == ("x velocity [mm/s]", "y velocity [mm/s]", "time [s]")
    assert legend(figure) == ["truth", "paper's network", "analytic Jacobian"]
    conditions = MADE["conditions"]()
    assert [axes.get_title() for axes in conditions.axes] == ["quiet", "noisy", "", ""]
    np.testing.assert_allclose(line(conditions.axes[3], "paper's network").get_ydata(), PATH[:, 1] * 2000)


def test_labelled_arrays_do_as_well():
    figures.velocities(xarray.DataArray(TIME), xarray.DataArray(PATH, dims=("time", "axis")), {})


def test_trajectories_are_drawn_as_seen():
    axes = MADE["trajectories"]().axes[0]
    assert axes.yaxis_inverted()
    assert axes.get_aspect() == 1
    np.testing.assert_allclose(line(axes, "truth").get_xydata(), PATH * 1000)
    np.testing.assert_allclose(line(axes, "mouth").get_xydata(), [[0, 30]])
    assert line(axes, "mouth").get_marker() != line(axes, "left eye").get_marker()
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [mm]", "y [mm]")


def test_maps_mark_the_taxels_within_one_of_a_landmark():
    figure = MADE["maps"]()
    panels = np.reshape(figure.axes, (2, 3))
    assert [axes.get_title() for axes in panels[0]] == ["0 steps", "100 steps", "200 steps"]
    nose = line(panels[1, 2], "nose").get_xydata()
    np.testing.assert_allclose(nose, GRID[1:4, 2:5].reshape(-1, 2) * 1000)
    corner = line(panels[1, 2], "mouth").get_xydata()
    np.testing.assert_allclose(corner, GRID[3:, 2:5].reshape(-1, 2) * 1000)
    assert len({axes.get_xlim() for axes in panels[0]}) == len({axes.get_ylim() for axes in panels[0]}) == 1
    assert all(axes.yaxis_inverted() and axes.get_aspect() == 1 for axes in figure.axes)
    dots = panels[1, 2].patches[0].get_path().vertices[::2]
    np.testing.assert_allclose(dots, GRID.reshape(-1, 2) * 1000)
    assert legend(figure) == ["nose", "mouth", "true places"]
    with pytest.raises(InvalidConfig, match="taxel 35"):
        figures.map_snapshots(MAPS, STEPS, {"nose": 35})


def test_topological_error_shows_mean_and_deviation_and_the_span_beside():
    figure = MADE["topological"]()
    error, span = figure.axes
    np.testing.assert_allclose(line(error, "direct sight").get_ydata(), [8, 4, 1])
    (band,) = (found for found in error.collections if isinstance(found, PolyCollection))
    vertices = band.get_paths()[0].vertices
    np.testing.assert_allclose(
        [vertices[vertices[:, 0] == 0, 1].min(), vertices[vertices[:, 0] == 0, 1].max()], [8 - 2**0.5, 8 + 2**0.5]
    )
    assert (error.get_ylabel(), span.get_ylabel()) == ("topological error [taxels]", "map span / true span")
    assert {text.get_text() for axes in figure.axes for text in axes.texts} == {"chance", "true size"}
    assert span.get_ylim()[1] >= 1, "the true size is in sight"
    assert error.get_ylim()[0] == 0


def test_error_by_distance_has_medians_quartiles_and_the_zero_jacobian():
    figure = MADE["distance"]()
    circle, face = figure.axes
    assert [axes.get_title() for axes in figure.axes] == ["on the circle", "on the face"]
    assert figure.get_supxlabel() == "distance from the seen circle [rad]"
    assert circle.get_yscale() == "log"
    median = circle.containers[0].lines[0].get_ydata()
    np.testing.assert_allclose(median, np.median((0.1 + TIME).reshape(5, 12), axis=1))
    bars = np.array(circle.containers[0].lines[2][0].get_segments())[..., 1]
    np.testing.assert_allclose(bars, np.quantile((0.1 + TIME).reshape(5, 12), [0.25, 0.75], axis=1).T)
    assert (len(circle.containers), len(face.containers)) == (1, 2)
    assert all("zero Jacobian" in [text.get_text() for text in axes.texts] for axes in figure.axes)
    assert legend(figure) == ["least squares", "other"]


def test_touching_face_shows_taxels_landmarks_and_circle_in_front():
    figure = MADE["face"]()
    body, face = figure.axes
    assert "seen circle of the hand" in legend(figure)
    assert len(face.patches[0].get_path().vertices) == 2 * len(TAXELS), "every taxel is seen from in front"
    assert len(face.images) == len(body.images) == 1
    assert np.ptp(body.get_xlim()) > np.ptp(face.get_xlim())
    assert {text.get_text() for text in (*body.texts, *face.texts)} == {"10 cm", "2 cm"}
    circle = [np.isfinite(found.get_xydata()).all(1) for found in face.get_lines() if len(found.get_xydata()) == 50]
    assert circle[0].all(), "the circle is in front of the face"
    assert not circle[1].any()
    with pytest.raises(InvalidConfig, match="taxel 99"):
        figures.touching_face(ROBOT, {}, TAXELS, {"nose": 99})
    with pytest.raises(InvalidArray, match="taxels"):
        figures.touching_face(ROBOT, {}, TAXELS[:, :2])


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: figures.velocities(TIME, PATH[:-1], {}), "'truth' has shape"),
        (lambda: figures.velocities(TIME, PATH, {"a": PATH[:, :1]}), "'a' has shape"),
        (lambda: figures.trajectories(PATH, {"a": "path"}), "'a' is no array"),
        (lambda: figures.map_snapshots(MAPS[:2], STEPS), "maps"),
        (lambda: figures.map_snapshots(MAPS, STEPS, true_map=GRID[1:]), "true_map"),
        (lambda: figures.topological_error(STEPS, {"a": [[1.0, 2.0]]}), "'a'"),
        (lambda: figures.error_by_distance({"on_face": TIME}, {"a": {"on_face": TIME[1:]}}), "'a'"),
    ],
)
def test_arrays_that_do_not_fit_are_named(make, what):
    with pytest.raises(InvalidArray, match=what):
        make()
