"""One table of labels, which a study may override; a name is text, whatever is in it."""

import pytest

from bodyimage_kin import figures


def test_names_of_classes_and_of_studies_are_one():
    assert figures.label("LeastSquares") == figures.label("least_squares") == "least squares"
    assert figures.label("PaperMLP") == "paper's network"
    assert figures.label("an_unknown") == "an unknown"
    assert figures.label("_hidden_") == "hidden"
    assert figures.label("_") == "_"


def test_labels_of_ones_own_come_first_and_go_again():
    with figures.labelled({"mine": "my network", "paper_mlp": "theirs"}):
        with figures.labelled({"mine": "ours"}):
            assert figures.label("mine") == "ours"
            assert figures.label("PaperMLP") == "theirs"
        assert figures.label("mine") == "my network"
    assert figures.label("mine") == "mine"
    with pytest.raises(RuntimeError), figures.labelled({"mine": "lost"}):
        raise RuntimeError
    assert figures.label("mine") == "mine"


@pytest.mark.parametrize("name", ["$x$", "a$b$c", r"$\frac", "100 %", "<script>", '"quoted"', "a/b", "é", "{}"])
def test_names_are_drawn_as_they_are(tmp_path, name):
    with figures.style():
        figure, grid = figures.panels()
        figures.learning([0, 1], {name: [[1.0, 2.0]]}, grid[0, 0])
        grid[0, 0].set_title(figures.drawn(name))
        figures.letters([grid[0, 0]])
        figures.legend(figure)
    figure.draw_without_rendering()
    assert set(figures.values(figure)["series"]) == {name}
    saved = figures.save(figure, tmp_path, "one")[0].read_text()
    assert "<script" not in saved
    assert 'class="mi"' not in saved
