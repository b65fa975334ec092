from __future__ import annotations

import pytest
from tests.stand_ins import OTHERS, SHARED, others


def test_where_others_data_lies_no_test_loses_it() -> None:
    if not SHARED.is_dir():
        pytest.skip("needs the folder `shared` beside the repository; stand-ins serve")
    assert [kind for kind in OTHERS if not others(kind)] == []
