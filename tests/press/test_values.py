"""What a press artefact may hold: every wrong value is refused, at save, at load and at inspection. Seeds stated."""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.fuzz.press_mutants import mutants, press_of, taken_apart

from prooflight.commissioning.training.learn import fitted_forest
from prooflight.detectors.matched_filter.ranking import FOREST, Forest
from prooflight.detectors.paper.bayes import BayesDetector, BayesianNetwork
from prooflight.errors import PressError
from prooflight.files.schema import Misfit
from prooflight.inspection.inspector import Inspector
from prooflight.prediction.predict import predict
from prooflight.press.artefact import Press

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from prooflight.pages.raster import Page

    MakePage = Callable[..., Page]

DETECTORS = ("chi-square", "bayes", "matched_filter")
INFINITE = (np.nan, np.inf, -np.inf)


@pytest.fixture(scope="module")
def whole(trained_press: Press) -> Press:
    """A press with both detectors; what the paper's learned is noise."""
    statistics = np.random.default_rng(4).standard_normal((80, 3))
    labels = ["correct", "misprint"] * 40
    network = BayesianNetwork.learn(statistics, labels, misprint_rate=0.01, bins=8)
    return trained_press.with_detector(
        "bayes", BayesDetector(network=network, threshold=0.1, unit=np.ones(1))
    )


@pytest.fixture(scope="module")
def artefact(whole: Press, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "whole.press"
    whole.save(path)
    return path.read_bytes()


@pytest.fixture(scope="module")
def ruined(whole: Press, make_page: MakePage) -> tuple[Page, np.ndarray]:
    """A page and a scan of it with a hole of 23 x 6 mm."""
    page = make_page(7, height_mm=15.0)
    scan = np.rint(predict(page, sensors=whole.sensors, geometry=whole.geometry).expected_dn)
    scan[:, 60:120, 100:320] = whole.sensors[0].top_code_dn
    return page, scan.astype(np.uint16)


def refusal(path: Path, source: bytes) -> str:
    """Why an artefact is refused, in one line."""
    path.write_bytes(source)
    with pytest.raises(PressError) as refused:
        Press.load(path)
    text = str(refused.value)
    assert text.startswith(f"{path}: ")
    assert "prooflight press build" in text
    return text


def with_array(source: bytes, name: str, place: Any, value: float) -> bytes:
    texts, arrays = taken_apart(source)
    arrays[name] = arrays[name].copy()
    arrays[name][place] = value
    return press_of(texts, arrays)


def with_field(source: bytes, path: str, value: Any) -> bytes:
    texts, arrays = taken_apart(source)
    document = json.loads(texts["document"])
    holder: Any = document
    *above, last = (int(part) if part.isdigit() else part for part in path.split("."))
    for part in above:
        holder = holder[part]
    holder[last] = value
    return press_of(texts | {"document": json.dumps(document, sort_keys=True)}, arrays)


@pytest.mark.parametrize(
    ("name", "place", "value"),
    [
        ("sensor0.mean_dn", (3, 4, 5, 6), np.nan),
        ("sensor0.mean_dn", (0, 0, 0, 0), 0.0),  # dark paper
        ("sensor0.variance_dn2", (0, 0, 0, 0), 0.0),
        ("sensor0.column_gain", 17, -1.0),
        ("sensor0.column_gain", 17, np.inf),
        ("sensor0.footprint_across", -1, 1.1),
        ("sensor0.correction_near", (3, 3), 2.0),
        ("inks.model.density", (0, 0), np.nan),
        ("detectors.matched_filter.own", 0, np.nan),
        ("detectors.matched_filter.own", 0, 1e6),  # no longer rising
        ("detectors.matched_filter.reference", (0, 0), np.inf),
        ("detectors.matched_filter.values", (0, 0), np.nan),
        ("detectors.matched_filter.page_features", (0, 0), np.inf),
        ("detectors.matched_filter.tolerance.shift", 5, np.nan),
        ("detectors.matched_filter.tolerance.scale", 5, 0.0),
        ("detectors.matched_filter.tolerance.scatter.light", 0, 0.0),
        ("detectors.matched_filter.tolerance.sd", 5, 0.0),
        ("detectors.matched_filter.tolerance.family", 5, 10_000),
        ("detectors.matched_filter.tolerance.tail", (7, 0), 1e6),  # begins where no quantile is
        ("detectors.matched_filter.tolerance.baseline", (0, 0), np.nan),
        ("detectors.bayes.log_likelihood", (0, 0, 0), 0.0),  # no distribution
        ("detectors.bayes.unit", 0, np.nan),
    ],
)
def test_a_wrong_value_under_a_right_digest_is_refused_and_named(
    artefact: bytes, tmp_path: Path, name: str, place: Any, value: float
) -> None:
    assert name.rpartition("_")[0] in refusal(tmp_path / "a.press", with_array(artefact, name, place, value))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("good_pages_per_false_alarm", float("nan")),
        ("good_pages_per_false_alarm", float("inf")),
        ("good_pages_per_false_alarm", "10"),
        ("geometry.pixel_pitch_mm", -0.1),
        ("geometry.line_pitch_mm", 0.0),
        ("geometry.pixels", 401),
        ("geometry.colour", "red"),
        ("supersampling", True),
        ("sensors.0.dark_variance_dn2", 0.0),
        ("sensors.0.footprint_reach_mm", 470.0),
        ("costs.misprint_rate", float("nan")),
        ("clipped", [{"black": 0.0, "saturation": 0.0}] * 2),
        ("variation", {"ink": {"gain_print_percent": float("nan")}}),
        ("variation", {"ink": [[[[[[[1]]]]]]]}),
        ("variation", {"world": "ideal"}),
        ("detectors.matched_filter.false_alarm_rate", 0.0),
        ("detectors.matched_filter.real", 19),  # of 18 pages
        ("detectors.matched_filter.real", -1),
        ("detectors.matched_filter.tolerance.threshold", float("nan")),
        ("detectors.matched_filter.tolerance.names", ["fit"]),
        ("detectors.bayes.threshold", float("nan")),
        ("detectors.chi", {}),
        ("ink_facts", {"name": "a", "model": "alchemy"}),
    ],
)
def test_a_wrong_field_under_a_right_digest_is_refused_and_named(
    artefact: bytes, tmp_path: Path, field: str, value: Any
) -> None:
    told = refusal(tmp_path / "a.press", with_field(artefact, field, value))
    assert field.split(".")[-1].split("_")[0] in told


def test_a_geometry_that_asks_for_more_memory_than_a_page_needs_is_refused(
    artefact: bytes, tmp_path: Path
) -> None:
    fine = with_field(artefact, "geometry.line_pitch_mm", 0.002)
    texts, arrays = taken_apart(with_field(fine, "geometry.pixels", 65536))
    for name in ("column_gain", "column_offset_dn"):
        arrays[f"sensor0.{name}"] = np.resize(arrays[f"sensor0.{name}"], 65536)
    assert "GiB" in refusal(tmp_path / "a.press", press_of(texts, arrays))


def test_a_file_that_says_it_is_larger_than_memory_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "sparse.press"
    with path.open("wb") as file:
        file.truncate(40 << 30)
    with pytest.raises(PressError, match="40960 MiB"):
        Press.load(path)


def test_what_would_not_be_read_is_not_written(whole: Press, tmp_path: Path) -> None:
    sensor = whole.sensors[0]
    mean = sensor.mean_dn.copy()
    mean[1, 2, 3, 4] = np.nan
    for spoilt, field in (
        (replace(whole, sensors=(replace(sensor, mean_dn=mean),)), "sensor0.mean_dn"),
        (replace(whole, good_pages_per_false_alarm=np.nan), "good_pages_per_false_alarm"),
        (replace(whole, geometry=replace(whole.geometry, lead_in_mm=-1.0)), "geometry.lead_in_mm"),
    ):
        with pytest.raises(PressError, match=field):
            spoilt.save(tmp_path / "a.press")
    assert not list(tmp_path.iterdir())


def float_arrays(held: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Ways to every array of floats in what a press holds."""
    for field in fields(held):
        value = getattr(held, field.name)
        if is_dataclass(value):
            yield from float_arrays(value, (*path, field.name))
        elif isinstance(value, np.ndarray) and value.dtype.kind == "f" and value.size:
            yield (*path, field.name)


def spoilt(held: Any, path: tuple[str, ...], value: float, rng: np.random.Generator) -> Any:
    """The same with one value of an array changed."""
    first, *rest = path
    if rest:
        return replace(held, **{first: spoilt(getattr(held, first), tuple(rest), value, rng)})
    array = getattr(held, first).copy()
    array.reshape(-1)[int(rng.integers(array.size))] = value
    return replace(held, **{first: array})


@pytest.mark.parametrize("value", INFINITE)
def test_nobody_judges_by_a_press_in_which_any_number_is_not_finite(whole: Press, value: float) -> None:
    """Seed 5: a value of each array, past save and load; numbers that stand alone as well."""
    rng = np.random.default_rng(5)
    spoilt_presses = [
        replace(whole, sensors=(spoilt(whole.sensors[0], path, value, rng),))
        for path in float_arrays(whole.sensors[0])
    ]
    spoilt_presses += [
        whole.with_detector(name, spoilt(model, path, value, rng))
        for name, model in whole.detectors.items()
        for path in float_arrays(model)
    ]
    assert len(spoilt_presses) > 20
    spoilt_presses += [
        replace(whole, good_pages_per_false_alarm=value),
        replace(whole, geometry=replace(whole.geometry, pixel_pitch_mm=value)),
        replace(whole, sensors=(replace(whole.sensors[0], backing_dn=value),)),
    ]
    for press in spoilt_presses:
        for name in DETECTORS:
            with pytest.raises(PressError):
                Inspector.of(press, name)
    with pytest.raises(PressError):
        replace(
            Inspector.of(whole, "matched_filter"), press=spoilt_presses[0]
        )  # as a running press is followed


def test_spoilt_presses_are_refused_in_one_line_or_judge_by_finite_numbers(
    artefact: bytes, tmp_path: Path, ruined: tuple[Page, np.ndarray]
) -> None:
    """Seeds (11, 0) to (11, 99). Of those that load, a few judge: ours takes four seconds for a new press."""
    page, scan = ruined
    path, judged, refused = tmp_path / "mutant.press", 0, []
    for index in range(100):
        path.write_bytes(mutants(artefact, np.random.default_rng([11, index])))
        try:
            press = Press.load(path)
        except PressError as error:
            refused.append(str(error))
            continue
        judged += 1
        names = [name for name in DETECTORS if name == "chi-square" or name in press.detectors]
        for name in names if judged == 1 else names[:2] if judged <= 3 else ():
            inspector = Inspector.of(press, name)
            with np.errstate(all="ignore"):
                verdict = inspector.inspect(inspector.prepare(page), scan, scan_name="ruined").verdict
            if verdict.verdict == "good":
                assert np.isfinite([verdict.score, verdict.threshold, verdict.probability]).all()
    assert judged > 1
    assert len(refused) > 75
    assert all(text.startswith(f"{path}: ") for text in refused)


def grown(rng: np.random.Generator) -> Forest:
    columns = rng.standard_normal((60, 5))
    return fitted_forest(columns, columns[:, 0] > 0, np.ones(60), rng=rng, trees=3)


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("left", lambda forest: np.zeros_like(forest.left)),  # round and round for ever
        ("right", lambda forest: forest.right + forest.right.size),
        ("left", lambda forest: np.full_like(forest.left, -1)),
        ("column", lambda forest: np.where(forest.column < 0, -1, 5)),
        ("root", lambda forest: forest.root + forest.left.size),
        ("root", lambda forest: forest.root[:0]),
        ("cut", lambda forest: np.full_like(forest.cut, np.nan)),
        ("share", lambda forest: forest.share + 1),
        ("cut", lambda forest: forest.cut[:-1]),
    ],
)
def test_a_forest_whose_indices_lead_astray_is_refused(
    name: str, wrong: Callable[[Forest], np.ndarray]
) -> None:
    forest = grown(np.random.default_rng(3))
    arrays = {part: getattr(forest, part) for part in FOREST}
    Forest.check(arrays, 5, under="")
    with pytest.raises(Misfit):
        Forest.check(arrays | {name: wrong(forest)}, 5, under="")


def test_a_press_in_good_order_keeps_its_digest(artefact: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.press"
    path.write_bytes(artefact)
    loaded = Press.load(path)
    texts, _ = taken_apart(artefact)
    assert loaded.digest == texts["digest"]
    assert loaded.save(tmp_path / "b.press") == texts["digest"]
