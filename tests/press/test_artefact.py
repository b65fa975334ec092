from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import save_file

from prooflight.detectors.paper.bayes import BayesDetector, BayesianNetwork
from prooflight.errors import PressError
from prooflight.pages.pdf.engine import RipEngine
from prooflight.pages.pdf.rip_model import RipModel
from prooflight.pages.screen import Screen
from prooflight.prediction.predict import predict
from prooflight.press.artefact import KIND, SCHEMA, Press, _digest

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.pages.raster import Page

ARRAYS = ("mean_dn", "variance_dn2", "column_offset_dn", "column_gain")


@pytest.fixture
def saved(press: Press, tmp_path: Path) -> Path:
    path = tmp_path / "one.press"
    press.save(path)
    return path


def refused(path: Path) -> str:
    with pytest.raises(PressError) as refusal:
        Press.load(path)
    text = str(refusal.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    assert "prooflight press build" in text  # what to do about it
    return text


def unchecked(press: Press, path: Path) -> None:
    """Write a press with a right digest, whatever it holds."""
    arrays, document = press._parts()
    metadata = {
        "kind": KIND,
        "schema": str(SCHEMA),
        "digest": _digest(arrays, document),
        "document": document,
    }
    save_file(arrays, path, metadata)


def with_metadata(source: Path, target: Path, **changes: str) -> None:
    """A copy of a press file with other metadata beside the same arrays."""
    with safe_open(source, framework="numpy") as file:
        metadata = dict(file.metadata()) | changes
        arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a dict
    save_file(arrays, target, metadata)


def test_a_press_comes_back_as_it_was_saved(two_sensor_press: Press, tmp_path: Path, page: Page) -> None:
    path = tmp_path / "two.press"
    two_sensor_press.save(path)
    loaded = Press.load(path)
    assert loaded.digest == two_sensor_press.digest
    assert loaded.geometry == two_sensor_press.geometry
    assert loaded.costs == two_sensor_press.costs
    assert loaded.name == two_sensor_press.name
    assert loaded.supersampling == two_sensor_press.supersampling
    assert loaded.good_pages_per_false_alarm == two_sensor_press.good_pages_per_false_alarm
    assert dict(loaded.origin) == dict(two_sensor_press.origin)
    np.testing.assert_array_equal(loaded.appearance_srgb, two_sensor_press.appearance_srgb)
    for one, other in zip(loaded.sensors, two_sensor_press.sensors, strict=True):
        for name in ARRAYS:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
            assert getattr(one, name).dtype == getattr(other, name).dtype
        np.testing.assert_array_equal(one.footprint.across, other.footprint.across)
        np.testing.assert_array_equal(one.footprint.along, other.footprint.along)
        for name in ("name", "dark_variance_dn2", "backing_dn", "backing_variance_dn2", "top_code_dn"):
            assert getattr(one, name) == getattr(other, name)
        assert one.footprint.reach_mm == other.footprint.reach_mm
    before, after = (
        predict(page, sensors=press.sensors, geometry=press.geometry) for press in (two_sensor_press, loaded)
    )
    np.testing.assert_array_equal(before.expected_dn, after.expected_dn)
    np.testing.assert_array_equal(before.variance_dn2, after.variance_dn2)


def test_following_fringes_travels_and_is_another_press(press: Press, tmp_path: Path) -> None:
    path = tmp_path / "fringes.press"
    assert press.fringes
    press.save(path)
    assert Press.load(path).fringes
    assert replace(press, fringes=False).digest != press.digest


def test_the_rips_resolution_travels_and_says_nothing_where_nobody_knows(
    press: Press, tmp_path: Path
) -> None:
    told = replace(press, rip_dpi=1200.0)
    told.save(tmp_path / "told.press")
    assert Press.load(tmp_path / "told.press").rip_dpi == 1200
    assert told.digest != press.digest
    press.save(tmp_path / "untold.press")
    assert Press.load(tmp_path / "untold.press").rip_dpi is None
    with safe_open(tmp_path / "untold.press", framework="numpy") as file:
        assert "rip_dpi" not in file.metadata()["document"]


def test_the_rips_engine_travels_and_is_mupdf_where_nothing_is_stated(press: Press, tmp_path: Path) -> None:
    front_end = RipEngine(name="command", command=("rip", "{pdf}", "{page}", "{dpi}", "{out}"))
    for engine in (RipEngine(name="ghostscript"), front_end):
        other = replace(press, rip_engine=engine)
        other.save(tmp_path / "other.press")
        assert Press.load(tmp_path / "other.press").rip_engine == engine
        assert other.digest != press.digest
    press.save(tmp_path / "usual.press")
    assert Press.load(tmp_path / "usual.press").rip_engine == RipEngine()
    with safe_open(tmp_path / "usual.press", framework="numpy") as file:
        assert "rip_engine" not in file.metadata()["document"]


def test_an_artefact_whose_engine_cannot_be_meant_is_refused(press: Press, tmp_path: Path) -> None:
    engine = RipEngine(name="ghostscript")
    object.__setattr__(engine, "command", ("rm", "-r", "/"))
    model = RipModel(fill="any-part", growth_um=(1.0, 2.0, 3.0, -4.0), growth_sd_um=(1.0, 1.0, 1.0, 2.0))
    imitated = replace(
        press, rip_dpi=1200.0, rip_model=model, screen=Screen(kind="am", dpi=1200.0, lpi=175.0)
    )
    imitated.save(tmp_path / "imitated.press")
    read = Press.load(tmp_path / "imitated.press")
    assert (read.rip_model, read.screen, read.digest) == (model, imitated.screen, imitated.digest)
    assert read.digest != press.digest
    with pytest.raises(PressError, match="rip_engine"):
        replace(press, rip_engine=engine).save(tmp_path / "other.press")


def test_a_press_without_fringes_is_what_it_was_before_there_were_any(press: Press, tmp_path: Path) -> None:
    """Artefacts of before stay readable, and their digests theirs."""
    path = tmp_path / "plain.press"
    replace(press, fringes=False).save(path)
    with safe_open(path, framework="numpy") as file:
        assert "fringes" not in file.metadata()["document"]
    assert not Press.load(path).fringes


def test_other_costs_make_another_press_that_scores_alike(press: Press, tmp_path: Path) -> None:
    first = press.with_costs(false_alarm_cents=1.0, missed_misprint_cents=3.0)
    second = first.with_costs(false_alarm_cents=1.0, missed_misprint_cents=4.0)
    second.save(tmp_path / "x.press")
    loaded = Press.load(tmp_path / "x.press")
    assert loaded.digest == second.digest not in (first.digest, press.digest)
    assert {press.digest, first.digest, second.digest} <= loaded.scored_alike
    assert press.scored_alike == {press.digest}
    assert loaded.costs.misprint_rate == press.costs.misprint_rate
    statistics = np.random.default_rng(4).standard_normal((80, 3))
    network = BayesianNetwork.learn(statistics, ["correct", "misprint"] * 40, misprint_rate=0.01, bins=8)
    taught = loaded.with_detector("bayes", BayesDetector(network=network, threshold=0.5, unit=np.ones(1)))
    assert first.digest not in taught.scored_alike, "another detector scores otherwise"
    dearer = taught.with_costs(false_alarm_cents=1.0, missed_misprint_cents=3.0).detectors["bayes"]
    assert isinstance(dearer, BayesDetector)
    assert dearer.threshold == 0.25, "stopping pays from 1 / (1 + 3)"
    with pytest.raises(ValueError, match="must be above 0"):
        press.with_costs(false_alarm_cents=0.0, missed_misprint_cents=3.0)


def test_saving_gives_the_digest_and_leaves_nothing_else_behind(press: Press, tmp_path: Path) -> None:
    path = tmp_path / "new" / "two.press"
    assert press.save(path) == press.digest
    assert press.save(path) == press.digest  # over the old one
    assert [file.name for file in path.parent.iterdir()] == ["two.press"]


def test_the_digest_changes_with_anything_in_it(press: Press) -> None:
    sensor = press.sensors[0]
    nudged = sensor.column_gain.copy()
    nudged[17] = np.nextafter(nudged[17], np.float32(2))
    others = [
        replace(press, name="another"),
        replace(press, supersampling=3),
        replace(press, good_pages_per_false_alarm=5.0),
        replace(press, origin={**press.origin, "seed": "99"}),
        replace(press, geometry=replace(press.geometry, lead_in_mm=2.5)),
        replace(press, costs=replace(press.costs, misprint_rate=0.02)),
        replace(press, sensors=(replace(sensor, column_gain=nudged),)),
        replace(press, sensors=(replace(sensor, top_code_dn=4094),)),
        replace(press, sensors=(sensor, sensor)),
    ]
    digests = {press.digest, *(other.digest for other in others)}
    assert len(digests) == len(others) + 1


def test_there_is_no_such_file(tmp_path: Path) -> None:
    assert "no such file" in refused(tmp_path / "none.press")
    assert "no such file" in refused(tmp_path)  # a folder


@pytest.mark.parametrize(
    "content", [b"", b"\0" * 7, b"\0" * 100, b"[light]\nilluminant = 'D65'\n", b"PK\x03\x04" * 50]
)
def test_what_is_no_press_artefact(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.press"
    path.write_bytes(content)
    assert "not a press artefact" in refused(path)


def test_tensors_of_something_else(tmp_path: Path) -> None:
    path = tmp_path / "model.safetensors"
    save_file({"weights": np.zeros(3, np.float32)}, path)
    assert "not a press artefact" in refused(path)


def test_another_schema_is_named_beside_the_one_that_is_read(saved: Path, tmp_path: Path) -> None:
    other = tmp_path / "old.press"
    with_metadata(saved, other, schema="999")
    text = refused(other)
    assert "schema 999" in text
    assert f"reads schema {SCHEMA}" in text


@pytest.mark.parametrize("changes", [{"digest": "0" * 64}, {"document": "{}"}])
def test_content_that_does_not_fit_its_digest(saved: Path, tmp_path: Path, changes: dict[str, str]) -> None:
    other = tmp_path / "other.press"
    with_metadata(saved, other, **changes)
    assert "digest" in refused(other)


def test_tables_of_another_number_of_nodes_are_refused(press: Press, tmp_path: Path) -> None:
    path = tmp_path / "coarse.press"
    sensor = press.sensors[0]
    every_other = (slice(None, None, 2),) * 4
    coarse = replace(
        sensor, mean_dn=sensor.mean_dn[every_other], variance_dn2=sensor.variance_dn2[every_other]
    )
    spoilt = replace(press, sensors=(coarse,))
    with pytest.raises(PressError, match="nodes"):
        spoilt.save(path)
    unchecked(spoilt, path)
    assert "nodes" in refused(path)


def test_a_truncated_file_is_refused_wherever_it_ends(saved: Path, tmp_path: Path) -> None:
    whole = saved.read_bytes()
    header = 8 + int.from_bytes(whole[:8], "little")
    cut = tmp_path / "cut.press"
    for end in (1, 8, 9, header // 2, header - 1, header, header + 1, len(whole) // 2, len(whole) - 1):
        cut.write_bytes(whole[:end])
        refused(cut)


def flip_and_load(saved: Path, bad: Path, place: int, bit: int) -> None:
    whole = saved.read_bytes()
    if not bad.exists():
        bad.write_bytes(whole)
    with bad.open("r+b") as file:
        file.seek(place)
        file.write(bytes([whole[place] ^ 1 << bit]))
    refused(bad)
    with bad.open("r+b") as file:
        file.seek(place)
        file.write(whole[place : place + 1])


def test_a_flipped_bit_in_the_arrays_is_found(saved: Path, tmp_path: Path) -> None:
    size = saved.stat().st_size
    header = 8 + int.from_bytes(saved.read_bytes()[:8], "little")
    rng = np.random.default_rng(1)
    for place in [header, size - 1, *rng.integers(header, size, 20)]:
        flip_and_load(saved, tmp_path / "bad.press", int(place), int(rng.integers(8)))


def test_a_flipped_bit_in_the_header_is_found(saved: Path, tmp_path: Path) -> None:
    whole = saved.read_bytes()
    header = 8 + int.from_bytes(whole[:8], "little")
    rng = np.random.default_rng(1)
    names = [range(whole.index(name), whole.index(name) + len(name)) for name in (b'"kind"', b'"schema"')]
    places = {*range(16), *range(16, header, 47), *(place for name in names for place in name)}
    # the names of these two entries have a test of their own
    for name in (b'"document"', b'"digest"'):
        places -= set(range(whole.index(name), whole.index(name) + len(name)))
    for place in sorted(places):
        flip_and_load(saved, tmp_path / "bad.press", place, int(rng.integers(8)))
    assert Press.load(tmp_path / "bad.press")  # every flip was taken back


@pytest.mark.parametrize("name", [b'"document"', b'"digest"'])
def test_a_flipped_bit_in_the_name_of_an_entry_is_found(saved: Path, tmp_path: Path, name: bytes) -> None:
    start = saved.read_bytes().index(name)
    for place in range(start, start + len(name)):
        flip_and_load(saved, tmp_path / "bad.press", place, 1)
