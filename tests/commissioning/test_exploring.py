"""Designs against a parameter: what must rise and fall, closed forms, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.camera.camera import respond
from prooflight.commissioning.camera.exploring import PATCHES, Design, Variation, designs, varied
from prooflight.commissioning.characterise import variance_dn2
from prooflight.errors import PressFileError, RequestError
from prooflight.inks.built_in import built_in_inks
from prooflight.prediction.tables import node_fractions
from prooflight.press.press_file import PressFile

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.commissioning.camera.exploring import SensorDesign
    from prooflight.inks.reflectance import LogLinear


def explored(press_file: PressFile, *texts: str) -> list[Design]:
    return list(designs(press_file, [Variation.parse(text) for text in texts]))


def of(found: list[Design], number: Callable[[SensorDesign], float], sensor: int = 0) -> list[float]:
    return [number(design.sensors[sensor]) for design in found]


def rises(values: list[float]) -> bool:
    return bool((np.diff(values) > 0).all())


def test_the_prototype_as_it_is(prototype: PressFile) -> None:
    (design,) = explored(prototype, "lens.f_number=2.8")
    camera = prototype.camera()
    (answer,) = respond(camera, prototype.inks().reflectance(PATCHES))
    (sensor,) = design.sensors
    assert design.vary == {"lens.f_number": 2.8}
    assert design.field_mm == camera.field_mm
    assert design.a4_pages_per_s == pytest.approx(2770 * 0.10543 / 297)
    assert sensor.white_dn == pytest.approx(answer.dn_mean[0])
    # far from both ends of the range clipping changes nothing
    assert sensor.white_sigma_dn == pytest.approx(answer.dn_sigma_temporal[0], rel=1e-9)
    dark_dn = camera.sensors[0].dark_e * camera.sensors[0].dn_per_e
    assert sensor.tint_snr == pytest.approx(
        (answer.dn_mean[1] - dark_dn) / answer.dn_sigma_temporal[1], rel=1e-9
    )
    assert not sensor.saturates


def test_table_sigma_spans_the_tables(prototype: PressFile) -> None:
    (design,) = explored(prototype, "lens.f_number=2.8")
    axis = node_fractions()[[0, 5, 16, 27, 32]]
    recipes = np.stack(np.meshgrid(axis, axis, axis, axis, indexing="ij"), axis=-1)
    camera = prototype.camera()
    electrons = camera.sensors[0].electrons(camera.irradiance_photons(prototype.inks().reflectance(recipes)))
    sigma = np.sqrt(variance_dn2(camera.sensors[0], electrons))
    assert design.sensors[0].table_sigma_min_dn == pytest.approx(sigma.min())
    assert design.sensors[0].table_sigma_max_dn == pytest.approx(sigma.max())


def test_more_light_means_a_better_signal_until_it_saturates(prototype: PressFile) -> None:
    found = explored(prototype, "light.luminance_cd_m2=20,50,100,200")
    for number in (lambda s: s.white_snr, lambda s: s.tint_snr, lambda s: s.solid_snr, lambda s: s.white_dn):
        assert rises(of(found, number))
    assert [design.sensors[0].saturates for design in found] == [False, False, False, True]
    assert found[-1].sensors[0].white_dn == pytest.approx(4095)
    # four times the light where shot noise rules: twice the ratio, within what read noise still adds
    assert found[2].sensors[0].white_snr / found[0].sensors[0].white_snr == pytest.approx(5**0.5, rel=0.03)


def test_read_noise_spoils_black_most(prototype: PressFile) -> None:
    found = explored(prototype, "sensor.read_noise_e=0,15,30,60,120")
    white, solid = of(found, lambda s: s.white_snr), of(found, lambda s: s.solid_snr)
    assert rises(white[::-1])
    assert rises(solid[::-1])
    assert solid[0] / solid[-1] > 2 * white[0] / white[-1]
    assert rises(of(found, lambda s: s.table_sigma_min_dn))
    assert len(set(of(found, lambda s: s.mtf_nyquist_across))) == 1


def test_a_smaller_aperture_is_darker_and_softer(prototype: PressFile) -> None:
    found = explored(prototype, "lens.f_number=2.8,4,5.6,8")
    assert rises(of(found, lambda s: s.white_snr)[::-1])
    assert rises(of(found, lambda s: s.mtf_nyquist_across)[::-1])
    assert rises(of(found, lambda s: s.mtf_nyquist_along)[::-1])


def test_faster_lines_carry_more_pages_with_less_light(prototype: PressFile) -> None:
    found = explored(prototype, "sensor.line_rate_hz=2770,5540,14000")
    pages = [design.a4_pages_per_s for design in found]
    assert pages[2] / pages[0] == pytest.approx(14000 / 2770)
    assert rises(of(found, lambda s: s.white_snr)[::-1])


def test_paper_out_of_step_smears(prototype: PressFile) -> None:
    in_step = 0.10543 * 2770
    found = explored(prototype, f"transport.speed_mm_s={in_step},{1.002 * in_step},{1.005 * in_step}")
    assert rises(of(found, lambda s: s.mtf_nyquist_along)[::-1])
    assert found[1].a4_pages_per_s == pytest.approx(1.002 * found[0].a4_pages_per_s)


def test_binning_makes_lines_coarser_and_pages_no_faster(prototype: PressFile) -> None:
    one, three = explored(prototype, "transport.binning_along=1,3")
    assert three.line_pitch_mm == pytest.approx(3 * one.line_pitch_mm)
    assert three.a4_pages_per_s == one.a4_pages_per_s
    assert three.sensors[0].mtf_nyquist_along < one.sensors[0].mtf_nyquist_along


def test_saturation_leaves_room_for_the_brightest_column(prototype: PressFile) -> None:
    # White is 2857 DN at 100 cd/m2: it passes 4095 from 143.3 cd/m2, with 4 sigma of 1 % PRNU from 137.8 on.
    found = explored(prototype, "light.luminance_cd_m2=136,140,143")
    assert [design.sensors[0].saturates for design in found] == [False, True, True]
    assert all(design.sensors[0].white_dn < 4095 for design in found)


def test_several_fields_make_a_grid(prototype: PressFile) -> None:
    found = explored(prototype, "lens.f_number=2.8,4", "light.illuminant=D50,A,F11")
    assert [tuple(design.vary.values()) for design in found] == [
        (number, light) for number in (2.8, 4) for light in ("D50", "A", "F11")
    ]
    assert len({design.sensors[0].white_dn for design in found}) == 6


def test_inks_are_fitted_once_for_each_choice_of_them(
    prototype: PressFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def inks(press_file: PressFile) -> LogLinear:
        asked.append("log-linear" if "log-linear" in press_file.text else "auto")
        paper = built_in_inks()
        return replace(paper, paper=paper.paper * (0.5 if asked[-1] == "log-linear" else 1.0))

    monkeypatch.setattr(PressFile, "inks", inks)
    found = explored(prototype, "inks.model=auto,log-linear", "lens.f_number=2.8,4")
    assert asked == ["auto", "log-linear"]
    # half the light: half the signal above dark
    bright, dim = (design.sensors[0].white_snr * design.sensors[0].white_sigma_dn for design in found[::2])
    assert dim == pytest.approx(bright / 2)


def test_one_sensor_or_all(two_sensor_file: PressFile) -> None:
    plain, all_of_them, second = (
        explored(two_sensor_file, text)[0]
        for text in ("lens.f_number=2.8", "sensor.read_noise_e=99", "sensor.2.read_noise_e=99")
    )
    assert all_of_them.sensors[0].solid_snr < plain.sensors[0].solid_snr
    assert second.sensors[0] == plain.sensors[0]
    assert second.sensors[1] == all_of_them.sensors[1] != plain.sensors[1]


def test_varying_changes_that_field_alone(prototype: PressFile) -> None:
    other = varied(prototype, {"light.luminance_cd_m2": 55.0, "sensor.1.bits": 10})
    assert other.camera().light.luminance_cd_m2 == 55.0
    sensor, before = other.camera().sensors[0], prototype.camera().sensors[0]
    np.testing.assert_array_equal(sensor.quantum_efficiency, before.quantum_efficiency)
    assert sensor.bits == 10
    assert other.costs() == prototype.costs()
    assert other.camera().lens == prototype.camera().lens


def test_blocks_that_the_file_leaves_out_can_be_varied(prototype: PressFile) -> None:
    assert "[transport]" not in prototype.text
    assert varied(prototype, {"transport.binning_along": 2}).camera().binning_along == 2


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "light.luminence_cd_m2=3",
            "light.luminence_cd_m2 is not a known field; did you mean luminance_cd_m2?",
        ),
        ("lite.luminance_cd_m2=3", "lite is not a known field"),
        ("sensor.read_noise=3", "sensor.1.read_noise is not a known field"),
        ("light=3", "light is not a single value"),
        ("sensor=3", "sensor is not a single value"),
        ("sensor.1=3", "sensor.1 is not a single value"),
        ("sensor.quantum_efficiency=3", "is not a single value"),
        ("light.illuminant.name=D50", "is not a single value"),
        ("sensor.2.bits=8", "there is no sensor 2; choose 1 to 1"),
        ("sensor.0.bits=8", "there is no sensor 0"),
        ("light.luminance_cd_m2=0", "light.luminance_cd_m2: "),
        ("light.luminance_cd_m2=bright", "light.luminance_cd_m2: "),
        ("light.luminance_cd_m2=nan", "light.luminance_cd_m2: "),
        ("light.illuminant=D651", "there is no illuminant 'D651'"),
        ("lens.object_distance_mm=10", "object_distance_mm must exceed focal_length_mm"),
    ],
)
def test_what_the_press_file_refuses_is_refused_in_its_own_words(
    prototype: PressFile, text: str, says: str
) -> None:
    with pytest.raises(PressFileError) as refusal:
        designs(prototype, [Variation.parse("lens.f_number=2.8,4"), Variation.parse(text)])
    line = str(refusal.value)
    assert says in line
    assert line.startswith("prototype.toml: ")
    assert "\n" not in line


@pytest.mark.parametrize("text", ["", "lens.f_number", "=3", "lens.f_number=", "lens.f_number=2,,3"])
def test_a_variation_names_a_field_and_values(text: str) -> None:
    with pytest.raises(RequestError, match="give FIELD=a,b,c"):
        Variation.parse(text)


def test_a_field_is_varied_once(prototype: PressFile) -> None:
    twice = [Variation.parse("lens.f_number=2"), Variation.parse("lens.f_number=4")]
    with pytest.raises(RequestError, match="names a field twice"):
        designs(prototype, twice)
