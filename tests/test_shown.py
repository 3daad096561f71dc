"""What objects say of themselves: short, in notebooks a table, and never their numbers."""

import re

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin._shown import Shown, brief, table
from bodyimage_kin.body_image import PostureSOM


@pytest.fixture(scope="module")
def things(body, circle, touch):
    exp = bk.experience(circle)
    learned = bk.estimators.RationalTrig().fit(exp)
    analytic = bk.estimators.Analytic(body).fit(exp)
    network = bk.estimators.PaperMLP(steps=2).fit(exp)
    ensemble = bk.estimators.Ensemble(bk.estimators.Ridge(), members=3).fit(exp)
    felt = bk.experience(touch)
    maps = bk.BodyImage.learn(felt, touch["true_hand_image"])
    return {
        "robot": body.robot,
        "body": body,
        "skin": body.skin,
        "patch": body.skin.layout,
        "learned": learned,
        "analytic": analytic,
        "network": network,
        "ensemble": ensemble,
        "maps": maps,
        "som": PostureSOM.fit(touch.q.values[0][:50], (3, 3), 0),
        "excitation": bk.metrics.excitation(circle, touch),
        "attribution": bk.metrics.attribute(torch.eye(3)[None, :2].double(), torch.zeros(1, 2, 3).double()),
        "study": bk.Study("infant", {"near": bk.motions.Circle()}, [bk.estimators.Ridge()], seeds=3),
    }


NAMES = (
    *("robot", "body", "skin", "patch", "learned", "analytic", "network", "ensemble", "maps", "som"),
    *("excitation", "attribution", "study"),
)


@pytest.mark.parametrize("name", NAMES)
def test_an_object_is_shown_in_a_line_and_in_a_notebook_as_a_small_table(things, name):
    thing = things[name]
    said, page = repr(thing), thing._repr_html_()
    assert said.startswith(type(thing).__name__)
    assert "\n" not in said
    assert len(said) < 1000
    assert page.count("<table>") == page.count("</table>") == 1
    assert 2 <= page.count("<tr>") <= 40
    assert len(page) < 5000
    for text in (said, page):
        assert not re.search(r"tensor\(|array\(|\d, \.\.\.", text), "arrays are shown by their shape"


def test_what_is_learned_says_from_what_to_what(things):
    assert "5 joints -&gt; 2 coordinates [m]" in things["learned"]._repr_html_()
    assert "(21, 21, 2) float64" in repr(things["maps"])
    assert "near" in repr(things["study"])
    assert "(441, 3) float64" in repr(things["skin"])


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (np.zeros((3, 4)), "(3, 4) float64"),
        (torch.zeros(7, dtype=torch.int64), "(7) int64"),
        (np.array([1.0, 1 / 3]), "[1, 0.3333]"),
        (1 / 3, "0.3333"),
        (True, "True"),
        (None, "None"),
        ([], "[]"),
        ((), "()"),
        ({}, "{0 entries}"),
        (("left", "right"), "(left, right)"),
        ([1.0] * 9, "[9 of float]"),
        ({"a": 1, "b": 2.0}, "{a: 1, b: 2}"),
        (dict.fromkeys(range(99), 0), "{99 entries}"),
        (b"abc", "3 bytes"),
        ("x" * 200, "x" * 76 + " ..."),
        ("two\nlines", "two lines"),
    ],
)
def test_a_value_is_said_in_a_few_words(value, said):
    assert brief(value) == said


def test_names_are_text_in_tables():
    page = table("<b>x</b>", "a :class:`~bodyimage_kin.Robot` of ``q``", {"<i>": "a & b"})
    assert page == (
        "<p><b>&lt;b&gt;x&lt;/b&gt;</b>: a bodyimage_kin.Robot of q</p>"
        "<table><tr><th>&lt;i&gt;</th><td>a &amp; b</td></tr></table>"
    )


def test_no_learned_jacobian_prints_its_numbers():
    def below(cls):
        return {cls, *(inner for one in cls.__subclasses__() for inner in below(one))}

    found = [cls for cls in below(bk.estimators.LearnedJacobian) if cls.__module__.startswith("bodyimage_kin.")]
    assert len(found) > 10
    for cls in found:
        assert cls.__repr__ is Shown.__repr__, cls
