"""Spot inks as CxF/X-4: what is stated is read on the package's grid, and what is not is refused by name."""

from __future__ import annotations

import numpy as np
import pytest

from prooflight.errors import ChartError
from prooflight.pages.spots.cxf import read_spot_ink, spot_names
from prooflight.spectra import WAVE_NM

ORANGE = np.linspace(0.05, 0.8, 36)


def spectrum(values: np.ndarray, extra: str = 'ColorSpecification="CS1"') -> str:
    text = " ".join(f"{value:.6f}" for value in values)
    return f"<cc:ColorValues><cc:ReflectanceSpectrum {extra}>{text}</cc:ReflectanceSpectrum></cc:ColorValues>"


def cxf(*, solid: str | None = None, sets: str | None = None) -> str:
    solid = spectrum(ORANGE) if solid is None else solid
    sets = sets or (
        '<sic:MeasurementSet Background="Substrate"><sic:Measurement TintLevel="0" ObjectRef="o0"/>'
        '<sic:Measurement TintLevel="100" ObjectRef="o2"/><sic:Measurement TintLevel="50" ObjectRef="o1"/>'
        '</sic:MeasurementSet><sic:MeasurementSet Background="Black"><sic:Measurement TintLevel="100" ObjectRef="o3"/>'
        "</sic:MeasurementSet>"
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<cc:CxF xmlns:cc="http://colorexchangeformat.com/CxF3-core" xmlns:sic="http://colorexchangeformat.com/CxF3-SIC">
  <cc:Resources><cc:ObjectCollection>
    <cc:Object ObjectType="Substrate" Id="o0">{spectrum(np.full(36, 0.9))}</cc:Object>
    <cc:Object ObjectType="Tint" Id="o1">{spectrum(np.full(36, 0.4))}</cc:Object>
    <cc:Object ObjectType="Tint" Id="o2">{solid}</cc:Object>
    <cc:Object ObjectType="Tint" Id="o3">{spectrum(np.full(36, 0.02))}</cc:Object>
  </cc:ObjectCollection>
  <cc:ColorSpecificationCollection><cc:ColorSpecification Id="CS1"><cc:MeasurementSpec>
    <cc:GeometryChoice><cc:SingleAngle><cc:SingleAngleConfiguration>Annular</cc:SingleAngleConfiguration>
      <cc:IlluminationAngle>45</cc:IlluminationAngle><cc:MeasurementAngle>0.0</cc:MeasurementAngle>
    </cc:SingleAngle></cc:GeometryChoice>
    <cc:WavelengthRange StartWL="380" Increment="10"/>
    <cc:Device><cc:DeviceIllumination>M1_Daylight</cc:DeviceIllumination></cc:Device>
  </cc:MeasurementSpec></cc:ColorSpecification></cc:ColorSpecificationCollection></cc:Resources>
  <cc:CustomResources><sic:SpotInkCharacterisation SpotInkName="Orange 021">{sets}</sic:SpotInkCharacterisation>
  </cc:CustomResources>
</cc:CxF>"""


def test_the_tints_of_an_ink_on_its_substrate_are_read() -> None:
    ink = read_spot_ink(cxf(), "Orange 021")
    assert ink.tint.tolist() == [0.0, 0.5, 1.0]
    assert np.allclose(ink.solid, ORANGE, atol=1e-6)
    assert ink.on_black is not None
    assert np.allclose(ink.on_black, 0.02)
    assert ink.condition == "M1, 45:0"
    for tint, value in ((0.0, 0.9), (0.5, 0.4)):
        assert np.allclose(ink.reflectance(tint), value)
    between = (np.sqrt(0.9) + np.sqrt(0.4)) / 2  # halfway between paper and the tint of 50 %
    assert np.allclose(ink.reflectance(0.25), between**2)


def test_a_library_of_colours_gives_the_solid_and_a_named_spectrum_is_taken() -> None:
    """CxF 3 without a characterisation, of which an object has the ink's name; and one spectrum a condition."""
    library = (
        cxf().replace("SpotInkCharacterisation", "Other").replace('Id="o2"', 'Id="o2" Name="Orange 021"')
    )
    ink = read_spot_ink(library, "Orange 021")
    assert (ink.tint.tolist(), ink.on_black) == ([1.0], None)
    assert np.allclose(ink.solid, ORANGE, atol=1e-6)
    both = spectrum(ORANGE, 'Name="m0" ColorSpecification="CS1"') + spectrum(
        ORANGE / 2, 'Name="m1" StartWL="380"'
    )
    named = cxf(solid=both).replace('ObjectRef="o2"', 'ObjectRef="o2" ReflectanceSpectrumNameRef="m1"')
    assert np.allclose(read_spot_ink(named, "Orange 021").solid, ORANGE / 2, atol=1e-6)
    assert spot_names(named, "here") == ("Orange 021",)


def test_another_grid_is_brought_to_ours() -> None:
    wave = np.arange(400, 701, 20)
    other = spectrum(np.interp(wave, WAVE_NM, ORANGE), 'StartWL="400" Increment="20"')
    ink = read_spot_ink(cxf(solid=other), "Orange 021")
    inside = (WAVE_NM >= 400) & (WAVE_NM <= 700)
    assert np.allclose(ink.solid[inside], ORANGE[inside], atol=1e-5)  # a line stays one


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is not XML"),
        ("<CxF/>", "holds no spectrum of the full ink"),
        ("<!DOCTYPE a [<!ENTITY b SYSTEM 'file:///etc/passwd'>]><CxF>&b;</CxF>", "declares a document type"),
        (cxf(solid=spectrum(100 * ORANGE)), "has a value that is not a reflectance factor"),
        (cxf(solid=spectrum(-ORANGE)), "has a value that is not a reflectance factor"),
        (cxf(solid=spectrum(ORANGE).replace("0.05", "red")), "a reflectance is"),
        (cxf(solid=spectrum(ORANGE[:10])), "of 380 to 470 nm, and 420 to 680 nm are needed"),
        (cxf(solid=spectrum(ORANGE, 'StartWL="inf"')), "StartWL is 'inf'"),
        (cxf(solid=spectrum(ORANGE[:1])), "has a spectrum of 1 values"),
        (cxf(solid=""), "holds no spectrum of the full ink"),
        (cxf().replace("Orange 021", "Green"), "holds no spectrum of the full ink"),
        (cxf().replace('ObjectRef="o2"', 'ObjectRef="o9"'), "has a measurement of 100 % without an object"),
        (cxf().replace('TintLevel="50"', 'TintLevel="many"'), "TintLevel is 'many'"),
    ],
)
def test_what_is_no_spectrum_is_refused_in_one_line(text: str, said: str) -> None:
    with pytest.raises(ChartError) as refused:
        read_spot_ink(text, "Orange 021")
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
