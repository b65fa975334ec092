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
