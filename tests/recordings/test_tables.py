"""Tables of other people's recordings: what is read is right, and what is wrong is said with its place."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
import scipy.io

from bodyimage_kin.errors import InvalidRecording, UnknownName
from bodyimage_kin.recordings import tables
from bodyimage_kin.recordings.tables import matching, read_table

PLAIN = "t,q_a,q_b,u\n0.0,1,2.5,100\n0.1,1.5,2,\n0.2,2,-1e-3,120\n"


def written(folder, text, name="table.csv", encoding="utf-8"):
    path = folder / name
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize(
    ("text", "name"),
    [
        (PLAIN, "table.csv"),
        (PLAIN.replace(",", ";"), "table.csv"),
        (PLAIN.replace(",", "\t"), "table.tsv"),
        ("\ufeff" + PLAIN, "table.csv"),
        (PLAIN.replace("\n", "\r\n"), "table.csv"),
        ("# from our robot\n\n" + PLAIN, "table.csv"),
        (PLAIN.replace(",", " , "), "table.csv"),
        (PLAIN.replace(",\n", ",NaN\n"), "table.txt"),
    ],
)
def test_a_text_is_read_however_it_is_written(tmp_path, text, name):
    table = read_table(written(tmp_path, text, name))
    assert list(table.columns) == ["t", "q_a", "q_b", "u"]
    np.testing.assert_array_equal(table.floats("q_a"), [1.0, 1.5, 2.0])
    np.testing.assert_array_equal(table.floats("q_b"), [2.5, 2.0, -1e-3])
    np.testing.assert_array_equal(table.floats("u"), [100.0, np.nan, 120.0])


def test_numbers_without_a_header_go_by_position(tmp_path):
    table = read_table(written(tmp_path, "1 2 3\n4 5 6\n", "table.dat"))
    assert list(table.columns) == ["0", "1", "2"]
    np.testing.assert_array_equal(table.floats("1"), [2.0, 5.0])


def test_decimal_commas_are_read_when_they_are_said_and_told_when_not(tmp_path):
    path = written(tmp_path, "a;b\n1,5;2\n2,5;3\n")
    np.testing.assert_array_equal(read_table(path, decimal=",").floats("a"), [1.5, 2.5])
    with pytest.raises(InvalidRecording, match=r"line 2, column 'a'.*decimal=','"):
        read_table(path).floats("a")


def test_a_wrong_cell_is_named_by_the_line_it_stands_in(tmp_path):
    table = read_table(written(tmp_path, "# note\na,b\n1,2\n\n# pause\n3,four\n"))
    with pytest.raises(InvalidRecording, match=r"'table.csv', line 6, column 'b': 'four' is no number"):
        table.floats("b")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2,3\n4,5,6\n", r"header has 2 names, line 2 has 3 values.*by position"),
        ("a,b,c\n1,2,3\n4,5\n", r"line 3 has 2 values, line 2 has 3"),
        ("a,b\n1,2\n3,4,5\n", r"header has 2 names, line 3 has 3 values"),
        ("a,a\n1,2\n", r"names 'a' twice"),
        ("a,b\n", r"no rows"),
        ("\n\n", r"no rows"),
        ("", r"is empty"),
    ],
)
def test_rows_that_do_not_fit_together_are_refused(tmp_path, text, message):
    with pytest.raises(InvalidRecording, match=message):
        read_table(written(tmp_path, text))


def test_a_short_header_can_be_read_by_position(tmp_path):
    table = read_table(written(tmp_path, "a,b\n1,2,3\n4,5,6\n"), by_position=True)
    np.testing.assert_array_equal(table.floats("2"), [3.0, 6.0])


def test_other_things_are_told_apart_from_tables(tmp_path):
    for name, content, message in [
        ("table.xlsx", b"PK", "ends in"),
        ("table.csv", "a,b\n1,2\n".encode("utf-16"), "UTF-16"),
        ("table.csv", b"\0\1\2\3", "no text"),
        ("table.parquet", b"nothing of the kind", "no Parquet file"),
        ("table.mat", b"nothing of the kind" * 20, "no MATLAB file"),
        ("table.mat", b"MATLAB 7.3 MAT-file" + bytes(200), "-v7"),
    ]:
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(InvalidRecording, match=message):
            read_table(path)
    with pytest.raises(InvalidRecording, match="cannot read"):
        read_table(tmp_path / "missing.csv")


def test_a_table_that_is_too_long_is_refused(tmp_path):
    with pytest.raises(InvalidRecording, match="more than 3 rows"):
        read_table(written(tmp_path, "a\n" + "1\n" * 4), most_rows=3)


def test_parquet(tmp_path):
    pandas, _ = pytest.importorskip("pandas"), pytest.importorskip("pyarrow")
    frame = pandas.DataFrame({"q_a": [1.0, 2.0], "count": [3, 4], "touched": [[1, 2], []]})
    frame.to_parquet(tmp_path / "table.parquet")
    table = read_table(tmp_path / "table.parquet")
    np.testing.assert_array_equal(table.floats("count"), [3.0, 4.0])
    assert [cell.tolist() for cell in table.lists("touched")] == [[1.0, 2.0], []]
    with pytest.raises(InvalidRecording, match="more than 1 rows"):
        read_table(tmp_path / "table.parquet", most_rows=1)


def test_matlab_structs_within_structs_and_lists_that_are_single(tmp_path):
    records = np.array(
        [
            ({"elbow": 0.1, "wrist": 1.0}, [4, 7], [[1.0, 2.0, 30.0], [1.0, 2.0, 31.0]]),
            ({"elbow": 0.2, "wrist": 2.0}, 5, [[1.0, 2.0, 32.0]]),
            ({"elbow": 0.3, "wrist": 3.0}, [], []),
        ],
        dtype=[("angles", object), ("taxels", object), ("cells", object)],
    )
    scipy.io.savemat(tmp_path / "touch.mat", {"touches": records})
    table = read_table(tmp_path / "touch.mat")
    assert list(table.columns) == ["angles.elbow", "angles.wrist", "taxels", "cells"]
    np.testing.assert_array_equal(table.floats("angles.wrist"), [1.0, 2.0, 3.0])
    assert [cell.tolist() for cell in table.lists("taxels")] == [[4.0, 7.0], [5.0], []]
    assert [cell.tolist() for cell in table.lists("cells[2]")] == [[30.0, 31.0], [32.0], []]
    with pytest.raises(InvalidRecording, match="record 1, column 'cells': "):
        table.floats("cells")


def test_a_matlab_matrix_goes_by_position_and_several_variables_must_be_told_apart(tmp_path):
    scipy.io.savemat(tmp_path / "one.mat", {"data": np.arange(6.0).reshape(3, 2), "note": 7.0})
    np.testing.assert_array_equal(read_table(tmp_path / "one.mat").floats("1"), [1.0, 3.0, 5.0])
    scipy.io.savemat(tmp_path / "two.mat", {"left": np.zeros((3, 2)), "right": np.ones((3, 2))})
    with pytest.raises(InvalidRecording, match="left, right; name one with variable="):
        read_table(tmp_path / "two.mat")
    np.testing.assert_array_equal(read_table(tmp_path / "two.mat", variable="right").floats("0"), np.ones(3))
    with pytest.raises(UnknownName, match="did you mean 'left'"):
        read_table(tmp_path / "two.mat", variable="lefd")


def test_a_small_matlab_file_that_unpacks_to_gigabytes_is_refused_before_it_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "MOST_BYTES", 1 << 20)
    packed = zlib.compress(bytes(64 << 20), 9)
    path = tmp_path / "bomb.mat"
    path.write_bytes(b"MATLAB 5.0".ljust(124) + b"\x00\x01IM" + struct.pack("<II", 15, len(packed)) + packed)
    assert path.stat().st_size < 1 << 20
    with pytest.raises(InvalidRecording, match="unpacks to more"):
        read_table(path)


def element(kind, data):
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def matrix(kind, dims, *parts):
    """An array of a MATLAB 5 file: its class, its size, and what it really holds."""
    size = struct.pack(f"<{len(dims)}i", *dims)
    return element(14, element(6, struct.pack("<II", kind, 0)) + element(5, size) + element(1, b"x") + b"".join(parts))


def nested(levels):
    inner = matrix(6, (1, 1), element(9, bytes(8)))
    for _ in range(levels):
        inner = matrix(1, (1, 1), inner)
    return inner


CLAIMS = {
    "structs": (matrix(2, (200_000_000, 1), element(5, struct.pack("<i", 32)), element(1, b"")), "200000000 x 1"),
    "cells": (matrix(1, (100_000_000, 1)), "100000000 x 1"),
    "numbers": (matrix(6, (1_000_000_000, 1), element(9, bytes(16))), "1000000000 x 1"),
    "a negative size": (matrix(6, (-5, 1), element(9, bytes(16))), "-5 x 1"),
    "a sparse one": (matrix(5, (2**31 - 1, 2**31 - 1), *[element(5, bytes(16))] * 2), "2147483647 x 2147483647"),
    "deep": (nested(50), "more than 32 structs within each other"),
}  # fmt: skip


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("case", CLAIMS)
def test_a_matlab_file_that_claims_more_than_it_holds_is_refused_before_anything_is_made_of_it(tmp_path, case, packed):
    content, message = CLAIMS[case]
    content = element(15, zlib.compress(content)) if packed else content
    (tmp_path / "hostile.mat").write_bytes(b"MATLAB 5.0".ljust(124) + b"\x00\x01IM" + content)
    with pytest.raises(InvalidRecording, match=message):
        read_table(tmp_path / "hostile.mat")


def test_honest_matlab_files_are_read_whatever_is_in_them(tmp_path):
    records = np.array(
        [
            (1.5, "text", [], {"inner": np.zeros((2, 3))}, np.int8([1, 2])),
            (2.5, "", [[1.0]], {"inner": 3}, np.int8([])),
        ],
        dtype=[("a", float), ("b", object), ("c", object), ("d", object), ("e", object)],
    )
    beside = {"empty": np.zeros((0, 0)), "flag": True, "complex": np.array([1 + 2j]), "note": "a note"}
    for compressed in (False, True):
        scipy.io.savemat(tmp_path / "honest.mat", {"touches": records, **beside}, do_compression=compressed)
        table = read_table(tmp_path / "honest.mat", variable="touches")
        np.testing.assert_array_equal(table.floats("a"), [1.5, 2.5])
        assert table["d.inner"][0].shape == (2, 3)
    scipy.io.savemat(tmp_path / "old.mat", {"data": np.arange(6.0).reshape(3, 2)}, format="4")
    np.testing.assert_array_equal(read_table(tmp_path / "old.mat").floats("1"), [1.0, 3.0, 5.0])


def test_a_pattern_names_what_stands_in_its_place():
    names = ["q.elbow", "q.wrist", "q.", "p.elbow", "xq.elbow"]
    assert matching(names, "q.*") == {"elbow": "q.elbow", "wrist": "q.wrist"}
    assert matching(names, "*.elbow") == {"q": "q.elbow", "p": "p.elbow", "xq": "xq.elbow"}
