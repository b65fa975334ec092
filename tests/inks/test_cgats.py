from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.errors import ChartError
from prooflight.inks.cgats import Table, number, parse, read_tables, write_tables

SMALL = '''CGATS.17
DESCRIPTOR\t"a chart"
KEYWORD "PRESS"
PRESS "one\ttwo"
NUMBER_OF_FIELDS 3
BEGIN_DATA_FORMAT
SAMPLE_ID NAME VALUE
END_DATA_FORMAT
NUMBER_OF_SETS 2
BEGIN_DATA
1 "Paper white" 0.5
2 "a ""b""" 1,5
END_DATA
'''
CELL = st.text(st.characters(codec="utf-8", exclude_categories=("Cs", "Cc", "Zl", "Zp")), max_size=8)


def test_keywords_columns_and_cells() -> None:
    (table,) = parse(SMALL, where="x")
    assert table.kind == "CGATS.17"
    assert table.keywords == (("DESCRIPTOR", "a chart"), ("KEYWORD", "PRESS"), ("PRESS", "one\ttwo"))
    assert table.keyword("press") == "one\ttwo"
    assert table.fields == ("SAMPLE_ID", "NAME", "VALUE")
    assert table.rows == (("1", "Paper white", "0.5"), ("2", 'a "b"', "1,5"))
    assert table.line(1) == "line 12"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_line_ends_and_encodings(tmp_path: Path, end: str, encoding: str) -> None:
    text = SMALL.replace("a chart", "Größe").replace("\n", end)
    path = tmp_path / "chart.txt"
    path.write_bytes(text.encode(encoding))
    assert read_tables(path)[0].keyword("DESCRIPTOR") == "Größe"
    assert read_tables(path)[0].rows == parse(SMALL, where="x")[0].rows


def test_lines_padded_with_tabs_read_the_same() -> None:
    padded = "\n".join(line + "\t" * 9 for line in SMALL.replace("\n\n", "\n").split("\n"))
    assert parse(padded, where="x") == parse(SMALL, where="x")


def test_names_with_spaces_need_no_quotes_between_tabs() -> None:
    text = (
        "BEGIN_DATA_FORMAT\nID\tNAME\tV\nEND_DATA_FORMAT\nBEGIN_DATA\n1\tPaper white\t3\t\t\n2\t\t4\nEND_DATA"
    )
    assert parse(text, where="x")[0].rows == (("1", "Paper white", "3"), ("2", "", "4"))


def test_comments_are_dropped_but_not_inside_quotes() -> None:
    text = SMALL.replace('"Paper white"', '"Paper #1"').replace("BEGIN_DATA\n", "# note\nBEGIN_DATA # now\n")
    assert parse(text, where="x")[0].rows[0] == ("1", "Paper #1", "0.5")


def test_names_and_data_on_the_line_of_their_begin() -> None:
    text = "BEGIN_DATA_FORMAT A B END_DATA_FORMAT\n"
    with pytest.raises(ChartError, match="END_DATA_FORMAT"):
        parse(text, where="x")  # END must stand on a line of its own
    text = "BEGIN_DATA_FORMAT A B\nEND_DATA_FORMAT\nBEGIN_DATA 1 2\n3 4\nEND_DATA"
    assert parse(text, where="x")[0].rows == (("1", "2"), ("3", "4"))


def test_several_tables_each_with_its_own_columns() -> None:
    second = 'CAL\nKEYWORD "X"\nBEGIN_DATA_FORMAT\nA\nEND_DATA_FORMAT\nBEGIN_DATA\n7\nEND_DATA\n'
    tables = parse(SMALL + "\n" + second, where="x")
    assert [table.kind for table in tables] == ["CGATS.17", "CAL"]
    assert tables[1].rows == (("7",),)
    assert tables[1].keywords == (("KEYWORD", "X"),)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "BEGIN_DATA"),
        ("%PDF-1.7 nothing here", "BEGIN_DATA"),
        (SMALL[: SMALL.index("2 ")], "without END_DATA: it is cut off"),
        (SMALL.replace("END_DATA_FORMAT", ""), "cut off"),
        (SMALL.replace("SAMPLE_ID NAME VALUE", "").replace("FIELDS 3", "FIELDS 0"), "BEGIN_DATA_FORMAT"),
        (SMALL.replace("0.5", ""), "line 11 has 2 values for 3 columns"),
        (SMALL.replace("SETS 2", "SETS 3"), "NUMBER_OF_SETS states 3, the table has 2"),
        (SMALL.replace("FIELDS 3", "FIELDS 4"), "NUMBER_OF_FIELDS states 4, the table has 3"),
        (SMALL.replace("NAME VALUE", "name NAME"), "the column NAME appears twice"),
        (
            SMALL.replace("SETS 2", "SETS " + "[" * 100_000),
            r"NUMBER_OF_SETS states \[\[.*\.\.\., the table has 2",
        ),
        (SMALL.replace("SETS 2", "SETS 1e999"), "NUMBER_OF_SETS states 1e999"),
        (
            SMALL.replace("BEGIN_DATA\n", "BEGIN_DATA\n" + "1 2 3\n" * 10_001),
            "DATA has more than 10000 lines",
        ),
        (SMALL.replace("NAME VALUE", " ".join(map(str, range(2001)))), "there are 2002 columns"),
        ("A 1\n" * 10_001 + SMALL, "more than 10000 keywords"),
        (SMALL * 101, "more than 100 tables"),
    ],
)
def test_what_is_wrong_is_one_line_that_names_the_file(text: str, message: str) -> None:
    with pytest.raises(ChartError, match=message) as caught:
        parse(text, where="chart.txt")
    assert str(caught.value).startswith("chart.txt: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("data", "message"), [(b"", "empty"), (b"\x00\x01\x02PK", "binary")])
def test_files_that_are_no_text(tmp_path: Path, data: bytes, message: str) -> None:
    path = tmp_path / "x"
    path.write_bytes(data)
    with pytest.raises(ChartError, match=message):
        read_tables(path)


@pytest.mark.parametrize(
    "cell", ["nan", "inf", "", "-", "N/A", "1.2.3", "0x10", "1,000.5", "1e999", "9" * 200]
)
def test_cells_that_are_no_numbers(cell: str) -> None:
    assert number(cell) != number(cell)


@given(
    keywords=st.lists(st.tuples(st.sampled_from(["DESCRIPTOR", "KEYWORD", "X"]), CELL), max_size=4),
    rows=st.lists(st.tuples(CELL, CELL), min_size=1, max_size=4),
    kind=st.sampled_from(["", "CGATS.17", "CTI3"]),
)
def test_what_is_written_reads_the_same(
    tmp_path_factory: pytest.TempPathFactory,
    keywords: list[tuple[str, str]],
    rows: list[tuple[str, str]],
    kind: str,
) -> None:
    table = Table(kind=kind, keywords=tuple(keywords), fields=("A", "B"), rows=tuple(rows))
    path = tmp_path_factory.getbasetemp() / "cgats.txt"
    write_tables(path, [table])
    assert read_tables(path) == (table,)
