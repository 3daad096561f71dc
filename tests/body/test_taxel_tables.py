"""Tables of the iCub's and NAO's skins: what is a taxel, what is not, and what is odd."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from bodyimage_kin.body import read_icub_taxels, read_nao_taxels
from bodyimage_kin.errors import InvalidConfig

COMPARISON = Path(__file__).parents[2] / "comparisons" / "skins"
HEAD = "name\tl_upper_arm\nspatial_sampling\ttaxel\ntaxel2Repr ( {} )\n[calibration]\n"
ROWS = [
    "0.01 0 0 1 0 0", "0.02 0 0 0.5 0 0", "0.03 0 0 1 0 0", "0.04 0.01 0 0 0 0", "0 0 0 0 0 0", "0.06 0 0 1 0 0",
    "0.07 0.01 0 1 0 0",
]  # fmt: skip


def icub(folder, kinds, rows=ROWS):
    path = folder / "arm.txt"
    path.write_text(HEAD.format(kinds) + "\n".join(rows) + "\n\n", encoding="utf-8")
    return path


def test_taxel2repr_decides_and_what_is_odd_is_noted(tmp_path):
    table = read_icub_taxels(icub(tmp_path, "0 0 -2 0 0 -1 0 12"))
    assert table.name == "l_upper_arm"
    assert table.counts == {"taxels": 4, "pads": 1, "dummies": 2}
    assert [note.split(" ", 1)[0] for note in table.notes] == ["taxel2Repr", "1", "1"]
    assert "8 entries for 7 rows: 1 entries without a row" in table.notes[0]
    skin = table.skin("l_upper_arm", forward=(1, 0, 0), right=(0, -1, 0))
    np.testing.assert_allclose(skin.link_positions[:, 0], [0.01, 0.02, 0.04, 0.07])
    np.testing.assert_array_equal(skin.taxels_of([0, 1, 2, 3, 4, 5, 6]), [0, 1, -1, 2, -1, -1, 3])
    np.testing.assert_allclose(np.linalg.norm(skin.link_normals, axis=1), 1.0)
    said = " ".join(skin.notes)
    assert "taxels 2 have no direction" in said
    assert "not of length 1 (0.5 to 1)" in said
    short = read_icub_taxels(icub(tmp_path, "0 0"))
    assert short.counts["taxels"] == 2
    assert "5 rows without an entry" in short.notes[0]


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", r"has no line \[calibration\]"),
        (HEAD.format("0 x") + "0 0 0 0 0 0\n", "taxel2Repr holds what is no whole number"),
        (HEAD.format("0") + "0 0 0\n", r"line 5: '0 0 0' is no row of 6 numbers"),
        (HEAD.format("0"), "has no rows of taxels"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path, text, match):
    path = tmp_path / "arm.txt"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidConfig, match=match):
        read_icub_taxels(path)
    with pytest.raises(InvalidConfig, match="cannot read the taxels"):
        read_icub_taxels(tmp_path / "none.txt")
    with pytest.raises(InvalidConfig, match="no taxel with a place"):
        read_icub_taxels(icub(tmp_path, "-1 -2")).skin("l")


def test_naos_places_are_sums_and_its_pads_no_taxels(tmp_path):
    rows = np.zeros((1 + 2 + 3 + 30, 3))
    rows[0], rows[1], rows[2] = [1, 0, 0], [0, 1, 0], [0, 2, 0]
    rows[3:6, 2] = [0.1, 0.2, 0.3]  # triangles 5, 2 (first patch) and 9
    rows[6:, 2] = np.arange(30) * 0.001
    np.savetxt(tmp_path / "part.txt", rows)
    table = read_nao_taxels(tmp_path / "part.txt", [[5, 2], [9]])
    assert table.counts == {"taxels": 30, "pads": 6, "dummies": 12 * 32 - 36}
    at = dict(zip(table.ids.tolist(), table.positions, strict=True))
    # Taxels of triangle 2 come first, as numbers do; 6 and 10 of a triangle are passed over.
    np.testing.assert_allclose(at[2 * 12 + 0], [1, 1, 0.2])
    np.testing.assert_allclose(at[2 * 12 + 11], [1, 1, 0.2 + 0.009])
    np.testing.assert_allclose(at[5 * 12 + 7], [1, 1, 0.1 + 0.016])
    np.testing.assert_allclose(at[9 * 12 + 0], [1, 2, 0.3 + 0.020])
    skin = table.skin("torso", np.diag([-1.0, -1.0, 1.0, 1.0]), forward=(1, 0, 0), right=(0, -1, 0))
    assert skin.count == 30
    np.testing.assert_allclose(skin.link_positions[0], [-1, -1, 0.2])
    np.testing.assert_array_equal(skin.taxels_of([24, 30, 34, 35, 0]), [0, -1, -1, 9, -1])
    np.testing.assert_array_equal(np.unique(skin.units), [2, 5, 9])
    with pytest.raises(InvalidConfig, match="has 36 rows; 2 triangles on 2 patches have 25"):
        read_nao_taxels(tmp_path / "part.txt", [[5], [9]])
    with pytest.raises(InvalidConfig, match="name each triangle once"):
        read_nao_taxels(tmp_path / "part.txt", [[5, 5], [9]])


@pytest.mark.real_data
def test_the_table_of_counts_is_what_the_published_files_hold(real_data):
    script = runpy.run_path(str(COMPARISON / "run.py"))
    assert script["table"](real_data) == (COMPARISON / "table.md").read_text(encoding="utf-8")
    tables = script["tables"](real_data)
    assert len(tables) == 23
    arm = tables["iCub left_arm_mesh"]
    assert arm.notes[0].startswith("19 rows are marked as taxels and have no place")
    assert arm.notes[1].startswith("74 rows have a place and are marked as no taxels")
    assert tables["NAO torso"].counts["taxels"] == 250
    assert tables["NAO torso"].skin("torso").pieces == 1
