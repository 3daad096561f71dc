"""Laws of a study as a published comparison."""

import json
import re

import numpy as np
import pytest
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig, OutputRefused, UnknownName
from bodyimage_kin.report._latex import latex
from bodyimage_kin.report._page import number
from bodyimage_kin.study.results import MISSING

ESTIMATORS = ["analytic", "least_squares", "rational_trig"]
PROBES = ["on_circle", "on_face"]
SEEDS = 6


@pytest.fixture
def results():
    """Two motions; rational_trig errs half as much as least squares in every recording."""
    draw = np.random.default_rng(0).uniform(0.5, 0.7, (1, 2, 1, SEEDS, 2))
    errors = draw * np.array([0.0, 1.0, 0.5])[:, None, None]
    dims = ("embodiment", "recording", "estimator", "seed", "probe")
    parts = errors[..., None] ** 2 * np.array([0.4, 0.0, 0.0, 0.6])
    return xr.Dataset(
        {
            "relative_error_use": (dims, errors),
            "attribution": ((*dims, "part"), parts),
            "displacement_error": (dims[:4], errors[..., 1]),
            "failure": (dims[:4], np.full(errors.shape[:4], "", dtype=object)),
        },
        {
            "embodiment": ["infant"], "recording": ["noise_free", "noisy"], "estimator": ESTIMATORS,
            "seed": range(SEEDS), "probe": PROBES, "part": ["scale", "mean_excited", "mean_unexcited", "variation"],
        },
        {"versions": json.dumps({"numpy": "1.2.3"})},
    )  # fmt: skip


def test_numbers_are_medians_and_paired_ratios(results, tmp_path):
    bk.report.publish(results, tmp_path, baseline="least_squares")
    numbers = json.loads((tmp_path / "results.json").read_text())
    row = numbers["scores"]["noisy"]["rational_trig"]
    errors = results["relative_error_use"].sel(recording="noisy", estimator="rational_trig", probe="on_face")
    assert row["relative_error_use"]["on_face"]["median"] == pytest.approx(float(errors.median()), rel=1e-3)
    assert row["relative_error_use"]["on_face"]["recordings"] == SEEDS
    assert row["ratio"]["ratio"] == pytest.approx(0.5)
    assert row["attribution"]["on_face"]["variation"] == pytest.approx(0.6 * float((errors**2).median()), rel=1e-3)
    # The truth has no ratio, and the baseline none to itself.
    assert "ratio" not in numbers["scores"]["noisy"]["analytic"]
    assert "ratio" not in numbers["scores"]["noisy"]["least_squares"]


def test_the_table_begins_with_the_smallest_error(results, tmp_path):
    lines = bk.report.publish(results, tmp_path, baseline="least_squares").read_text().splitlines()
    rows = [line for line in lines if line.startswith("| ")]
    assert [row.split(" | ")[0].strip("| ") for row in rows[:5]] == [
        "estimator", "---", "analytic Jacobian", "rational trigonometric", "least squares",
    ]  # fmt: skip
    assert "| 0.500 |" in rows[3]
    # Six recordings have values and no interval.
    assert not any("[" in row for row in rows)
    assert "numpy 1.2.3" in lines[-1]


def test_thirty_recordings_have_intervals(results, tmp_path):
    many = xr.concat([results.assign_coords(seed=results["seed"] + SEEDS * n) for n in range(5)], "seed")
    rows = bk.report.publish(many, tmp_path, baseline="least_squares").read_text().splitlines()
    (row, *_) = [line for line in rows if line.startswith("| rational")]
    assert "0.500 [0.500, 0.500]" in row
    assert row.count("[") == 2


def test_scores_that_failed_leave_gaps(results, tmp_path):
    results["relative_error_use"].loc[{"estimator": "rational_trig", "recording": "noisy"}] = np.nan
    results["failure"].loc[{"estimator": "rational_trig", "recording": "noisy"}] = "it broke"
    bk.report.publish(results, tmp_path, baseline="least_squares")
    numbers = json.loads((tmp_path / "results.json").read_text())
    assert numbers["scores"]["noisy"]["rational_trig"]["relative_error_use"]["on_face"]["median"] is None
    assert numbers["failures"][0]["failure"] == "it broke"
    assert (tmp_path / "errors.svg").stat().st_size > 5000
    assert "rational trigonometric" in (tmp_path / "errors.csv").read_text()


def test_recordings_that_failed_are_counted_in_the_table(results, tmp_path):
    results["relative_error_use"][0, 1, 2, :4] = np.nan
    results["failure"][0, 1, 2, :4] = "it broke"
    text = bk.report.publish(results, tmp_path, baseline="least_squares").read_text()
    assert text.count("(2 of 6)") == 1
    assert "| rational trigonometric (2 of 6) |" in text.split("### noisy")[1]


def test_a_row_that_was_not_asked_on_a_recording_has_no_place_there(results, tmp_path):
    for name in results.data_vars:
        if "estimator" in results[name].dims and name != "failure":
            results[name].loc[{"recording": "noisy", "estimator": "rational_trig"}] = np.nan
    text = bk.report.publish(results, tmp_path, baseline="least_squares").read_text()
    assert "rational trigonometric" in text.split("### noisy")[0]
    assert "rational trigonometric" not in text.split("### noisy")[1]
    assert "over 1 comparison: 1 estimator x 2 recordings, where both have a score" in text


def test_embodiments_are_compared_each_by_itself(results, tmp_path):
    other = results.assign_coords(embodiment=["other"]).copy(deep=True)
    other["relative_error_use"].loc[{"estimator": "rational_trig"}] *= 3.0
    bk.report.publish(xr.concat([results, other], "embodiment"), tmp_path, baseline="least_squares")
    scores = json.loads((tmp_path / "results.json").read_text())["scores"]
    assert scores["infant, noisy"]["rational_trig"]["ratio"]["ratio"] == pytest.approx(0.5)
    assert scores["other, noisy"]["rational_trig"]["ratio"]["ratio"] == pytest.approx(1.5)


def test_one_exact_recording_is_not_the_truth(results, tmp_path):
    results["relative_error_use"][0, :, 2, 0] = 1e-9
    bk.report.publish(results, tmp_path)
    numbers = json.loads((tmp_path / "results.json").read_text())
    assert numbers["baseline"] == "least_squares"
    assert numbers["scores"]["noisy"]["rational_trig"]["ratio"]["recordings"] == SEEDS


def test_table_page_and_comparison_are_of_one_family_that_is_named(results, tmp_path):
    # Three estimators beside the baseline, so that what is adjusted over is seen in the numbers.
    one, more = (results.sel(estimator=[name]) for name in ("rational_trig", "least_squares"))
    draw = np.random.default_rng(1).uniform(0.9, 1.3, one["relative_error_use"].shape)
    values = more["relative_error_use"].values * draw
    another = one.assign(relative_error_use=(one["relative_error_use"].dims, values))
    results = xr.concat([results, another.assign_coords(estimator=["another"])], "estimator", data_vars="minimal")
    found = bk.study.compare(results.sel(estimator=["least_squares", "rational_trig", "another"], probe="on_face"),
                             "relative_error_use", "least_squares")  # fmt: skip
    assert found.attrs["family"] == "4 comparisons: 2 estimators x 2 recordings"
    table = bk.report.publish(results, tmp_path, baseline="least_squares").read_text()
    assert "adjusted (Holm) over 4 comparisons: 2 estimators x 2 recordings on the face." in table
    numbers = json.loads((tmp_path / "results.json").read_text())["scores"]
    page = bk.report.write(results, tmp_path / "report.html", baseline="least_squares").read_text()
    said = " ".join(page.split())
    assert "adjusted (Holm) over 4 comparisons: 2 estimators x 2 recordings on the face." in said
    for recording in ("noise_free", "noisy"):
        for estimator in ("rational_trig", "another"):
            p = float(found["p_holm"].sel(recording=recording, estimator=estimator))
            assert numbers[recording][estimator]["ratio"]["p_holm"] == pytest.approx(p, rel=1e-3)
            assert f"</td><td>{number(p, 2)}</td>" in page


def test_refuses_what_is_no_comparison(results, tmp_path):
    with pytest.raises(UnknownName, match="nobody"):
        bk.report.publish(results, tmp_path, baseline="nobody")
    with pytest.raises(InvalidConfig, match="relative_error_use"):
        bk.report.publish(results.drop_vars("relative_error_use"), tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputRefused, match="cannot write"):
        bk.report.publish(results, tmp_path / "file")
    results["failure"][0, 0, 0, 0] = MISSING
    with pytest.raises(InvalidConfig, match="run the study to its end"):
        bk.report.publish(results, tmp_path)


def test_names_of_ones_own_are_labelled_and_change_no_table(results, tmp_path):
    odd = results.assign_coords(estimator=["analytic", "a|b <script>", "mine"], recording=["x | y", "noisy"])
    lines = bk.report.publish(odd, tmp_path, labels={"mine": "my network"}).read_text().splitlines()
    columns = {line.replace("\\|", "").count("|") for line in lines if line.startswith("|")}
    assert len(columns) == 1
    assert any(line.startswith("| my network |") for line in lines)
    assert any(line.startswith(r"| a\|b &lt;script> |") for line in lines)
    assert r"### x \| y" in lines
    assert set(json.loads((tmp_path / "results.json").read_text())["scores"]) == {"x | y", "noisy"}


def test_the_table_for_a_paper_says_the_same(results, tmp_path):
    odd = results.assign_coords(
        estimator=["analytic", r"50% & a_b $x$ \\ {", "mine"], recording=["noise_free", "noisy"]
    )
    lines = bk.report.publish(odd, tmp_path, labels={"mine": "my #1"}).read_text().splitlines()
    tex = (tmp_path / "table.tex").read_text()
    tables = re.findall(r"\\begin\{table\}.*?\\end\{table\}", tex, re.DOTALL)
    assert len(tables) == 2
    for table in tables:
        assert [table.count(rule) for rule in (r"\toprule", r"\midrule", r"\bottomrule")] == [1, 1, 1]
        # One cell a column in every row, whatever stands in a name.
        rows = [row for row in table.splitlines() if row.endswith(r"\\")]
        columns = len(re.search(r"\{tabular\}\{(\w+)\}", table)[1])
        assert {len(re.findall(r"(?<!\\)&", row)) + 1 for row in rows} == {columns}
        assert table.count("{") - table.count(r"\{") == table.count("}") - table.count(r"\}")
    assert r"50\% \& a b \$x\$" in tex
    assert r"my \#1" in tex
    assert tex.count("0.500 [0.500, 0.500]") == sum(line.count("0.500 [0.500, 0.500]") for line in lines)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1.2e-05 [3e+12]", r"$1.2 \cdot 10^{-5}$ [$3 \cdot 10^{12}$]"),
        ("< .001", "$<$ .001"),
        ("a\\b~^", r"a\textbackslash{}b\textasciitilde{}\textasciicircum{}"),
        ("e-mail 1e5x", "e-mail 1e5x"),
    ],
)
def test_text_is_set_as_it_is(text, said):
    assert latex(text) == said


def test_a_truth_that_is_asked_on_one_recording_alone_is_the_truth_still(results, tmp_path):
    results["relative_error_use"].loc[{"recording": "noisy", "estimator": "analytic"}] = np.nan
    assert bk.study.summary.exact(results, "relative_error_use") == ["analytic"]
    page = bk.report.write(results, tmp_path / "report.html").read_text()
    assert "Against least squares" in page
    assert "analytic Jacobian errs least" not in page
    # One that fails now and then where it is asked is not.
    results["relative_error_use"][0, 0, 0, :3] = np.nan
    results["relative_error_use"][0, 1, 0, :3] = np.nan
    assert bk.study.summary.exact(results, "relative_error_use") == []
