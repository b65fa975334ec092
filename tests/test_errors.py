import inspect
import pickle

import pytest

from prooflight import errors
from prooflight.errors import InputError, ProoflightError

KINDS = [
    kind
    for _, kind in inspect.getmembers(errors, inspect.isclass)
    if issubclass(kind, InputError) and kind is not InputError
]


@pytest.mark.parametrize("kind", KINDS)
def test_one_line_says_where_what_and_what_would_be_right(kind: type[InputError]) -> None:
    error = kind("press.toml", "lens.f_number is missing", remedy="add it")
    assert str(error) == "press.toml: lens.f_number is missing; add it"
    assert isinstance(error, ProoflightError)
    assert isinstance(error, ValueError)


@pytest.mark.parametrize("kind", KINDS)
def test_an_error_comes_whole_out_of_a_worker_process(kind: type[InputError]) -> None:
    error = kind("a.tif", "ends early", remedy="scan again")
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is kind
    assert (copy.where, copy.what, copy.remedy) == ("a.tif", "ends early", "scan again")
    assert str(copy) == str(error)


def test_every_kind_stands_in_the_table_that_says_which_one_when() -> None:
    assert KINDS
    for kind in KINDS:
        assert kind.__name__ in (errors.__doc__ or "")


def test_what_a_terminal_would_obey_is_shown_instead() -> None:
    error = InputError("a\x1b[31m\nb\u202e.pdf", "holds \x07 and\n  more", remedy="rename\tit")
    assert str(error) == r"a\x1b[31m\nb\u202e.pdf: holds \x07 and more; rename it"


def test_a_name_that_is_no_unicode_can_be_written() -> None:
    name = b"p\xff.tif".decode("utf-8", "surrogateescape")
    assert str(InputError(name, "is empty", remedy="copy it again")).encode() == (
        rb"p\udcff.tif: is empty; copy it again"
    )


@pytest.mark.parametrize("value", ["[" * 100_000, ".a" * 50_000, "a b " * 50_000, "\x00" * 100_000])
def test_nothing_quoted_is_longer_than_200_characters(value: str) -> None:
    lines = str(InputError("x", f"got {value!r}, not a number", remedy="mend it"))
    assert "\n" not in lines
    assert lines.startswith("x: got '")
    assert lines.endswith(", not a number; mend it")
    assert len(lines) < 200 + 50


def test_a_path_is_cut_in_its_middle_so_that_its_end_can_be_read() -> None:
    shown = errors.plain("/long" * 100 + "/p0003.tif")
    assert len(shown) == errors.QUOTED_MAX
    assert shown.endswith("/long/p0003.tif")
