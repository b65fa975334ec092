"""What a press file may say of its good prints, and what comes of it."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from prooflight.errors import PressFileError, RequestError
from prooflight.press.blocks import VARIATION, VARIATION_RANGES
from prooflight.press.press_file import PressFile
from prooflight.simulation.worlds import WORLDS, Amounts, amounts_of, world_named, worlds

if TYPE_CHECKING:
    from prooflight.press.artefact import Press


def file_with(prototype: PressFile, text: str) -> PressFile:
    return PressFile(Path("x.toml"), f"{prototype.text}\n{text}\n")


def test_the_amounts_are_the_files() -> None:
    stated = asdict(Amounts.stated())
    for block, amounts in worlds()["press"].items():
        expected = {name: tuple(v) if isinstance(v, list) else v for name, v in amounts.items()}
        assert stated[block] == expected
    assert {block for block, of in stated.items() if of} == set(worlds()["press"])


def test_a_press_file_may_state_every_amount_and_no_other() -> None:
    stated = asdict(Amounts.stated())
    assert {block: tuple(amounts) for block, amounts in stated.items() if amounts} == VARIATION
    ranges = {
        name for block in worlds()["press"].values() for name, v in block.items() if isinstance(v, list)
    }
    assert set(VARIATION_RANGES) == ranges


def test_a_file_that_says_nothing_varies_as_worlds_toml_has_it(prototype: PressFile, press: Press) -> None:
    assert prototype.variation() == {}
    assert amounts_of(press) == Amounts.stated()


def test_what_the_file_gives_replaces_what_worlds_toml_has(prototype: PressFile) -> None:
    text = "[variation.register]\nplane_um = 3.0\n[variation.paper]\nspecks_ink_percent = [1.0, 2.0]"
    given = file_with(prototype, text).variation()
    assert given == {"register": {"plane_um": 3.0}, "paper": {"specks_ink_percent": [1.0, 2.0]}}
    stated, plain = Amounts.stated(given), Amounts.stated()
    assert stated.register == replace(plain.register, plane_um=3.0)
    assert stated.paper == replace(plain.paper, specks_ink_percent=(1.0, 2.0))
    assert replace(stated, register=plain.register, paper=plain.paper) == plain


def test_all_times_multiplies_what_is_not_given() -> None:
    stated = Amounts.stated({"all_times": 2.0, "page": {"skew_deg": 0.5}})
    plain = Amounts.stated()
    assert stated.page.skew_deg == 0.5
    assert stated.page.shift_mm == 2 * plain.page.shift_mm
    assert stated.camera.sigma_error == tuple(bound**2 for bound in plain.camera.sigma_error)
    assert stated.paper.specks_per_page == 2 * plain.paper.specks_per_page
    assert stated.paper.specks_diameter_mm == plain.paper.specks_diameter_mm


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[variation.paper]\nwhite = 3.0", "variation.paper.white is not a known field"),
        ("[variation.pages]\nshift_mm = 1.0", "did you mean page?"),
        ("[variation]\nal_times = 1.0", "did you mean all_times?"),
        ("[variation.page]\nshift_mm = -1.0", "variation.page.shift_mm: .* greater than or equal to 0"),
        ("[variation.page]\nshift_mm = '1'", "variation.page.shift_mm: .* number"),
        ("[variation.page]\nshift_mm = inf", "variation.page.shift_mm"),
        ("[variation.camera]\nsigma_error = [2.0, 1.0]", "sigma_error must be .least, greatest."),
        ("[variation.camera]\nsigma_error = [0.0, 1.0]", "sigma_error"),
        ("[variation.paper]\nspecks_ink_percent = [1.0]", "specks_ink_percent"),
    ],
)
def test_a_wrong_variation_is_refused_by_name(prototype: PressFile, text: str, said: str) -> None:
    with pytest.raises(PressFileError, match=said) as refusal:
        file_with(prototype, text)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("world", WORLDS)
def test_worlds_are_known_by_name(world: str) -> None:
    assert world_named(world) == world
    with pytest.raises(RequestError, match="ideal, press or measured"):
        world_named(world.title())


def test_a_variation_survives_json(prototype: PressFile) -> None:
    import json

    given: dict[str, Any] = file_with(prototype, "[variation.camera]\nsigma_error = [0.9, 1.1]").variation()
    assert Amounts.stated(json.loads(json.dumps(given))).camera.sigma_error == (0.9, 1.1)
