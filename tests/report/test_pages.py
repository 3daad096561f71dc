"""Pages stand alone, ask for nothing, and show names as what they are: text."""

import csv
import io
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from urllib.parse import unquote

import numpy as np
import pytest
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin.errors import UnknownName
from bodyimage_kin.report._page import file_name, fixed, interval, number

HOSTILE = ("<script>alert(1)</script>", "\"quoted\" & 'single'", "../a/b\\c", "$x$ {{ 7 * 7 }}", "least_squares")
PROBES = ("on_circle", "in_front", "on_face")
PARTS = ("scale", "mean_excited", "mean_unexcited", "variation")
SEEDS, SIDE = 8, 4
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


def results_of(estimators, recordings=("noisy",), embodiments=("infant",)):
    """A study's results, made up: the k-th estimator errs k times as much as the first."""
    rng = np.random.default_rng(0)
    shape = (len(embodiments), len(recordings), len(estimators), SEEDS)
    dims = ("embodiment", "recording", "estimator", "seed")
    scale = 1.0 + np.arange(len(estimators))[:, None, None]
    errors = 0.1 * scale * rng.uniform(0.9, 1.1, (*shape, len(PROBES)))
    by_posture = (0.1 * scale * rng.uniform(0.5, 1.5, (*shape, len(PROBES) * SIDE**2))).reshape(
        (*shape, len(PROBES), SIDE**2)
    )
    away = np.broadcast_to(np.array([0.0, 0.01, 0.04])[:, None], (*shape[:2], SEEDS, len(PROBES), SIDE**2))
    away = away + rng.uniform(0, 0.01, away.shape)
    return xr.Dataset(
        {
            "relative_error_use": ((*dims, "probe"), errors),
            "relative_error": ((*dims, "probe"), 2 * errors),
            "attribution": ((*dims, "probe", "part"), errors[..., None] ** 2 * np.array([0.4, 0.1, 0.1, 0.4])),
            "displacement_error": (dims, errors[..., 0]),
            "relative_error_by_posture": ((*dims, "probe", "posture"), by_posture),
            "hand_distance_by_posture": ((*dims[:2], "seed", "probe", "posture"), away),
            "mahalanobis_distance_by_posture": ((*dims[:2], "seed", "probe", "posture"), 100 * away),
            "touch_trajectory_rmse": (dims, 0.01 * errors[..., 0]),
            "map_error": (dims, errors[..., 0]),
            "excitation": ((*dims[:2], "seed", "direction"), np.ones((*shape[:2], SEEDS, 3))),
            "failure": (dims, np.full(shape, "", dtype=object)),
        },
        {
            "embodiment": list(embodiments), "recording": list(recordings), "estimator": list(estimators),
            "seed": range(SEEDS), "probe": list(PROBES), "part": list(PARTS),
        },
        {
            "config": json.dumps({"labels": {"named": "what the study calls it"}}),
            "skin_shape": json.dumps(dict.fromkeys(embodiments, (SIDE, SIDE))),
            "versions": json.dumps({"numpy": "1.2.3"}),
            "urdf_sha256": json.dumps(dict.fromkeys(embodiments, "abc")),
        },
    )  # fmt: skip


class Reader(HTMLParser):
    """Tags, attributes and text of a page."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.attributes, self.said = [], [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data):
        self.said.append(data)


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    results = results_of(HOSTILE, HOSTILE[:1], HOSTILE[1:3])
    results["failure"][0, 0, 0, 0] = "ValueError: <img src=x onerror=alert(1)>"
    bk.report.write(results, path, baseline=HOSTILE[2])
    return path


def test_names_are_text_wherever_they_stand(hostile):
    page = Reader(hostile.read_text())
    assert not {"script", "img", "iframe", "object", "link"} & set(page.tags)
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    said = " ".join(page.said)
    for name in HOSTILE[:4]:
        assert name in said
    assert "{{" in said, "no template in a name is run"
    assert "49" not in re.findall(r"\$x\$ (\S+)", said)
    assert "<img src=x onerror=alert(1)>" in said


def test_a_page_names_nothing_outside_of_itself(hostile):
    page = hostile.read_text()
    for name, value in Reader(page).attributes:
        if name in ("src", "href", "xlink:href", "action", "data", "poster", "srcset"):
            assert value.startswith(("data:", "#")), (name, value)
    assert not re.search(r"@import|url\((?!#)", page)
    assert "Content-Security-Policy" in page
    identities = [value for name, value in Reader(page).attributes if name == "id"]
    assert len(identities) == len(set(identities)), "figures do not share names"
    assert set(re.findall(r'href="#([^"]+)"', page)) <= set(identities)
    assert set(re.findall(r"url\(#([^)]+)\)", page)) <= set(identities)


def test_every_figure_has_its_values_under_the_pointer_and_as_a_table(hostile):
    page = hostile.read_text()
    figures = re.findall(r"<figure id=.*?</figure>", page, re.DOTALL)
    assert len(figures) == 2 * (1 + 3 + 1), "by embodiment: ranking, chain; by recording: parts, distances, face"
    for one in figures:
        assert one.count("<title>") > 5
        link = re.search(r'download="([^"]*)" href="data:text/csv;charset=utf-8,([^"]*)"', one)
        assert re.fullmatch(r"[\w.-]+\.csv", link[1])
        rows = list(csv.reader(io.StringIO(unquote(link[2].replace("&amp;", "&").replace("&#39;", "'")))))
        assert len(rows) > 5
        assert len({len(row) for row in rows}) == 1
        assert "series" in rows[0]


def test_estimators_are_ranked_with_their_intervals(tmp_path):
    results = results_of(["worse", "named", "least_squares"])
    results["relative_error_use"] *= xr.DataArray([3.0, 1.0, 1.0], dims="estimator")
    page = bk.report.write(results, tmp_path / "report.html", baseline="named", labels={"worse": "theirs"}).read_text()
    rows = re.findall(r"<tr><td>(\d)\. ([^<]*)</td><td>([\d.]+) \[([\d.]+), ([\d.]+)\]", page)
    assert [row[:2] for row in rows] == [("1", "what the study calls it"), ("2", "theirs"), ("3", "least squares")] or [
        row[1] for row in rows
    ] == ["what the study calls it", "least squares", "theirs"]
    mean, lower, upper = map(float, rows[0][2:])
    assert lower <= mean <= upper
    assert "errs least" in page
    assert "against what the study calls it" in page
    with pytest.raises(UnknownName, match="did you mean 'worse'"):
        bk.report.write(results, tmp_path / "report.html", baseline="wrse")


def test_who_was_not_asked_of_a_recording_is_named_and_not_ranked(tmp_path):
    results = results_of(["a", "b", "other"], ["first", "second"])
    for name, one in results.data_vars.items():
        if "estimator" in one.dims and one.dtype.kind == "f":
            results[name].loc[{"recording": "second", "estimator": "other"}] = np.nan
    page = bk.report.write(results, tmp_path / "report.html").read_text()
    first, second = (part.split("<h3>", 1)[0] for part in re.split(r"<h3>(?:first|second)</h3>", page)[1:3])
    assert re.findall(r"<tr><td>(\d\. \w+)</td>", first) == ["1. a", "2. b", "3. other"]
    assert re.findall(r"<tr><td>(\d\. \w+)</td>", second) == ["1. a", "2. b"]
    assert "Not asked of this recording: other." in second
    assert "Not asked" not in first
    # The errors that rank stand first.
    assert [re.findall(r"<th>([^<]*)</th>", part)[1] for part in (first, second)] == ["on the face"] * 2


def test_scores_of_ones_own_are_shown_and_what_was_left_out_is_said(tmp_path):
    results = results_of(["a", "b"])
    about = {"long_name": "how <much> I like it", "units": "m"}
    results["liked"] = results["displacement_error"].assign_attrs(about)
    results["relative_error"] *= np.nan
    results.attrs["left_out"] = json.dumps({"map_span": {"it has no <skin>": ["infant/noisy/a", "infant/noisy/b"]}})
    page = bk.report.write(results, tmp_path / "report.html").read_text()
    assert "how &lt;much&gt; I like it [m]" in page
    assert "map span" in page
    assert '<td class="words">it has no &lt;skin&gt;</td><td>2</td>' in page
    assert page.count("<caption>") == 5, (
        "ranking, excitation, correlations, maps, what was left out: none of relative_error"
    )


def test_many_estimators_are_one_figure_each(tmp_path):
    few, many = (
        bk.report.write(
            results_of([f"estimator_{index}" for index in range(count)]), tmp_path / "page.html"
        ).read_text()
        for count in (3, 12)
    )
    assert few.count("<figure id=") == many.count("<figure id=")
    assert "Grey" not in few
    assert "Grey: all but the 6 that err least" in many
    assert len(many) < 4e6


def test_file_names_are_plain_and_never_two_alike():
    names = [*HOSTILE, "a b", "a-b", "a/b", "A" * 300, "", "...", "é", "plain_name-1.0"]
    made = [file_name(name) for name in names]
    assert len(set(made)) == len(names)
    assert all(re.fullmatch(r"\w[\w.-]{0,80}", name, re.ASCII) for name in made)
    assert file_name("plain_name-1.0") == "plain_name-1.0"


def test_numbers_in_tables_are_short_and_none_is_a_dash():
    assert [number(0.123456), number(-1234.5), number(0.0), number(float("nan")), number(None)] == [
        "0.123", "\N{MINUS SIGN}1.23e+03", "0", "–", "–",  # noqa: RUF001
    ]  # fmt: skip
    assert [fixed(-0.126), fixed(0.0123, 1, 1000), fixed(None)] == ["\N{MINUS SIGN}0.13", "12.3", "–"]  # noqa: RUF001
    assert interval((0.5, 0.25, 0.75)) == "0.5 [0.25, 0.75]"
    assert interval((0.5, float("nan"), float("nan"))) == "0.5"


# In a browser ---------------------------------------------------------------------------------------------------------


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed: pages are not opened")
def test_opening_a_page_makes_no_request(hostile, tmp_path):
    log = tmp_path / "net.json"
    command = [
        CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
        "--disable-component-update", "--no-first-run", "--host-resolver-rules=MAP * ~NOTFOUND",
        "--disable-default-apps", "--disable-sync",
        f"--user-data-dir={tmp_path / 'profile'}", f"--log-net-log={log}", "--window-size=390,800", "--dump-dom",
        hostile.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)
    assert "<h1>A study of learned Jacobians</h1>" in done.stdout
    assert "alert(1)</script>" not in done.stdout.replace("&lt;script&gt;alert(1)&lt;/script&gt;", "")
    text = log.read_text()
    kinds = json.loads(text.rstrip().rstrip(",") + ("" if text.rstrip().endswith("}") else "]}"))
    asked = {event["params"]["url"] for event in kinds["events"] if "url" in event.get("params", {})}
    # What the browser asks for itself, such as its own updates, is not the page's doing.
    of_page = {url for url in asked if not re.match(r"https?://[\w.-]*(google|gstatic|googleapis)\.com/|chrome", url)}
    assert {url for url in of_page if not url.startswith("data:")} <= {hostile.as_uri()}
