"""Every number that a page gives as a result is that of the committed results, and a wrong digit is found."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
spec = importlib.util.spec_from_file_location("audit", ROOT / "comparisons" / "audit.py")
audit = importlib.util.module_from_spec(spec)
sys.modules["audit"] = audit
spec.loader.exec_module(audit)

CLAIM = "fuke2007/summary.json#claims.training_converges"


@pytest.mark.parametrize("page", audit.pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_every_number_of_a_page_is_that_of_the_results(page):
    _, mistakes = audit.audited(page)
    assert not mistakes, "\n".join(map(str, mistakes))


def test_the_findings_of_the_readme_are_all_marked():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert "<!-- begin results -->" in text.partition("## What was found")[2]
    assert audit.audited(ROOT / "README.md")[0] >= 20


def test_as_many_claims_hold_and_cannot_fail_as_the_readme_says():
    claims = json.loads((ROOT / "comparisons/fuke2007/summary.json").read_text(encoding="utf-8"))["claims"]
    paper = [claim for claim in claims if claim["asked_by"] == "paper"]
    holds = [claim["name"] for claim in paper if claim["holds"]]
    idle = [claim["name"] for claim in paper if claim["met"] and claim["cannot_fail"]]
    assert (len(paper), holds, len(idle)) == (9, ["training_converges"], 5)
    said = (ROOT / "README.md").read_text(encoding="utf-8")
    for words in ("one thing holds", "Five more of its nine claims", "three do not hold"):
        assert words in " ".join(said.split())


def written(tmp_path, text):
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    found, mistakes = audit.audited(page)
    return found, [mistake.text for mistake in mistakes]


@pytest.fixture
def measured():
    (value,) = audit.results("fuke2007/summary.json", "claims.training_converges.measured")
    return value


def test_a_planted_wrong_digit_is_found(tmp_path, measured):
    right = f"{measured:.3f}"
    wrong = right[:-1] + str((int(right[-1]) + 1) % 10)
    mark = f"<!-- result: {CLAIM}.measured -->"
    assert written(tmp_path, f"The residual is {right}{mark}.") == (1, [])
    _, (said,) = written(tmp_path, f"The residual is {wrong}{mark}.")
    assert said.startswith(f"{wrong} should be {right}")


def test_as_many_numbers_are_meant_as_keys_are_named_and_lines_may_break(tmp_path):
    measured, least, most = audit.results("fuke2007/summary.json", "claims.training_converges.{measured,least,most}")
    mark = f"<!-- result: {CLAIM}.{{measured,least,most}} -->"
    text = f"Of 10 recordings {measured:.3f} ({least:.2f} to\n{most:.4f}){mark}."
    assert written(tmp_path, text) == (3, [])
    assert len(written(tmp_path, text.replace(f"({least:.2f}", "(0.99"))[1]) == 1
    assert "3 results and 1 numbers" in written(tmp_path, f"{measured:.3f}{mark}")[1][0]


@pytest.mark.parametrize(
    ("value", "printed"),
    [
        (0.527, "0.53"), (0.527, ".53"), (-0.034, "-0.03"), (0.527, "53 %"), (0.527, "52.7 %"), (6.2e-13, "6e-13"),
        (12345.6, "12,346"), (3.0, "3"), (-0.001, "0.00"), (0.02, "+0.02"),
    ],
)  # fmt: skip
def test_a_result_is_rounded_as_it_is_printed(value, printed):
    assert audit.as_printed(value, printed) == printed
    assert audit.as_printed(2 * value + 1, printed) != printed


def test_units_change_by_a_factor(tmp_path, measured):
    assert written(tmp_path, f"{1000 * measured:.1f} mm<!-- result: {CLAIM}.measured*1000 -->") == (1, [])


def test_what_is_not_there_is_told(tmp_path):
    for mark in (
        "fuke2007/summary.json#claims.no_such.measured",
        "nowhere/results.json#a",
        "fuke2007/summary.json#seeds.x",
    ):
        assert "no result" in written(tmp_path, f"0.1<!-- result: {mark} -->")[1][0]


def test_among_results_every_number_must_be_marked(tmp_path, measured):
    marked = f"{measured:.3f}<!-- result: {CLAIM}.measured -->"
    text = f"<!-- begin results -->\nOf 30 recordings {marked}, and {{}}.\n<!-- end results -->\nNot 0.7 here."
    assert written(tmp_path, text.format("none")) == (1, [])
    for bare in ("0.25", "25 %", ".5", "2e-3"):
        assert f"{bare} is not marked" in written(tmp_path, text.format(bare))[1][0]
    assert written(tmp_path, text.format("`0.25`, [0.5](page_0.5.md)")) != (1, [])
    assert written(tmp_path, text.format("`0.25`, [half](page_0.5.md)")) == (1, [])
