import ast
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import combinations, product
from pathlib import Path

import numpy as np
import pytest

import prooflight
import prooflight_console
import prooflight_line
import prooflight_studies
from prooflight import rng
from prooflight.rng import FREE, PURPOSES, seed_sequence, stream

PACKAGES = (prooflight, prooflight_line, prooflight_console, prooflight_studies)
ROOMS = [Path(package.__file__).parent for package in PACKAGES]

FIRST_DRAWS = {
    "a4-design": ((1009, 5), 1_919_216_677_537_076_213),
    "asked-sheets": ((1009, 5), 9_151_975_918_740_030_826),
    "bench-page": ((None,), 4_720_721_261_117_928_063),
    "bench-scan": ((None,), 2_412_946_043_537_042_528),
    "block-canary": ((1009,), 1_025_848_305_502_326_575),
    "blue-noise": ((None,), 1_554_512_917_892_278_413),
    "bootstrap": ((1009,), 385_325_927_127_435_721),
    "calibration-chart": ((1009, 100), 356_422_539_479_946_971),
    "calibration-session": ((1009,), 7_250_106_880_690_549_874),
    "camera-losses": ((1009, 5), 2_612_852_410_788_500_639),
    "camera-noise": ((1009, 5, 3), 5_020_129_652_767_825_134),
    "card-print": ((1009, 5, 3), 1_579_646_463_918_740_482),
    "chart-places": ((1009,), 521_124_781_773_066_565),
    "cluster-page": ((1009, 5), 7_820_638_227_940_510_615),
    "content-session": ((1009, 5), 5_652_217_154_539_499_028),
    "content-sheet": ((1009, 5), 2_100_493_183_153_170_183),
    "content-text": ((1009, 5, 1), 2_940_961_209_054_819_323),
    "content-text-session": ((1009, 5, 1), 4_531_026_556_372_941_617),
    "demonstration-misprints": ((1009,), 521_124_781_773_066_565),
    "design": ((1009, 5), 1_919_216_677_537_076_213),
    "dither": ((None,), 6_894_470_606_025_717_146),
    "drift-prints": ((1009,), 7_250_106_880_690_549_874),
    "drift-session": ((1009,), 521_124_781_773_066_565),
    "drum-faults": ((1009,), 6_027_154_353_121_568_424),
    "exchangeability-ties": ((1009,), 2_621_700_855_037_712_531),
    "feedback-weeks": ((1009, 5), 3_496_957_881_531_346_691),
    "gate-bootstrap": ((1009,), 138_083_491_781_258_133),
    "gate-plan": ((1009,), 7_901_104_941_177_281_969),
    "golden-bootstrap": ((1009,), 521_124_781_773_066_565),
    "golden-transforms": ((1009, 3, 7), 6_645_520_433_816_209_474),
    "hot-folder": ((1009,), 3_906_848_647_452_848_391),
    "ink-noise": ((1009,), 521_124_781_773_066_565),
    "ink-noise-median": ((1009,), 521_124_781_773_066_565),
    "lost-lines": ((1009,), 569_289_117_174_843_345),
    "misprint-rounding": ((4611686018427388913,), 2_482_527_606_925_646_877),
    "piece-places": ((1009, 5), 2_929_105_944_176_949_933),
    "pilot-print": ((1009, 5), 1_919_216_677_537_076_213),
    "plant-defect": ((1009, 5), 1_193_715_383_206_485_180),
    "plant-loop": ((1009, 5), 5_982_341_921_800_404_392),
    "plant-null": ((1009, 5), 788_990_227_585_418_401),
    "plant-prints": ((1009, 5), 4_437_441_749_663_533_206),
    "print": ((1009, 5), 1_919_216_677_537_076_213),
    "ranking-fold": ((1009, 5), 6_928_452_504_793_865_759),
    "ranking-trees": ((1009,), 943_118_068_068_258_848),
    "real-marks": ((1009, 1, 5), 1_789_310_558_682_318_248),
    "recipe-folds": ((1009,), 521_124_781_773_066_565),
    "record-backlog": ((1009,), 6_012_858_543_842_450_615),
    "record-searches": ((1009,), 5_640_848_414_793_784_161),
    "registration-prints": ((1009, 5, 0, 1), 8_112_125_929_312_080_517),
    "rich-black": ((1009, 5), 5_255_566_134_246_246_139),
    "rip-day": ((1009, 1, 5, 3), 395_816_162_075_808_973),
    "rip-print": ((1009, 1, 5, 3, 1), 433_820_492_119_429_785),
    "running-misprint": ((1009, 5), 5_834_175_257_914_571_699),
    "running-print": ((1009, 5), 8_343_934_146_202_452_808),
    "sample-job": ((1009,), 521_124_781_773_066_565),
    "sample-run": ((1009, 5), 9_084_315_059_277_352_604),
    "scene-print": ((1009, 3, 5, 6), 341_910_705_389_139_101),
    "scene-session": ((1009, 3, 5), 8_678_755_432_256_741_750),
    "session": ((1009,), 315_076_763_328_036_405),
    "soak-faults": ((1009,), 2_337_070_226_339_647_263),
    "soak-forms": ((1009, 5), 2_474_587_731_404_021_222),
    "soak-print": ((1009, 5), 3_742_383_001_044_777_958),
    "specimen": ((1009,), 521_124_781_773_066_565),
    "strangers": ((1009, 5), 6_821_742_018_009_614_985),
    "stress-bootstrap": ((1009,), 3_395_418_207_513_941_277),
    "stress-day": ((1009, 3, 5), 825_483_802_769_222_419),
    "stress-mark": ((1009, 3, 5, 6), 8_207_267_525_367_425_706),
    "stress-nuisance": ((4611686018427388913,), 6_724_837_927_352_164_882),
    "stress-ties": ((1009, 3), 2_222_362_647_029_989_308),
    "study-print": ((1009, 5, 6), 2_433_743_879_375_604_383),
    "study-session": ((1009, 3, 5), 6_813_199_604_076_897_392),
    "table-colours": ((1009, 7), 4_106_949_845_356_552_377),
    "table-noise": ((None, 16), 4_687_397_194_457_932_211),
    "training-print": ((1009, 5), 4_229_908_213_641_097_257),
    "training-session": ((1009, 5), 1_033_414_386_125_622_115),
    "trial-recipes": ((1009,), 521_124_781_773_066_565),
    "visible-blank": ((1009, 5), 806_040_518_042_974_456),
    "visible-curve": ((1009, 5, 7), 6_010_204_944_917_068_831),
    "visible-page": ((1009, 5), 8_677_513_752_292_932_729),
    "visible-print": ((1009, 5, 7, 11), 3_904_712_464_999_710_764),
    "world-piece": ((1009, 5), 1_919_216_677_537_076_213),
    "world-print": ((1009, 5), 2_929_105_944_176_949_933),
    "zones-came": ((1009, 5), 1_783_782_749_855_297_342),
    "zones-print": ((1009, 5), 1_332_178_824_500_025_682),
    "zones-strengths": ((1009,), 6_094_166_226_970_779_587),
    "zones-study": ((1009, 5), 6_147_749_140_511_012_783),
    "zones-trial": ((1009, 5), 3_237_579_180_550_576_644),
}
"""Seed and indices, and the first of ``integers(2**63)``; of most drawn before there was ``stream``."""

ONE_INDEX = {
    "a4-design",
    "calibration-chart",
    "design",
    "pilot-print",
    "print",
    "table-colours",
    "table-noise",
    "world-piece",
}
"""Number n of each is ``[seed, n]``: trailing zeros do not count."""
SEED_ALONE = {
    "bench-page",
    "bench-scan",
    "chart-places",
    "demonstration-misprints",
    "dither",
    "drift-session",
    "golden-bootstrap",
    "ink-noise",
    "ink-noise-median",
    "misprint-rounding",
    "recipe-folds",
    "sample-job",
    "specimen",
    "trial-recipes",
}
OF_COPIES = {"study-print"}
"""``[seed, n, k]`` for the k-th of several."""
KNOWN_SHARED = {
    "[seed]": ONE_INDEX | SEED_ALONE,
    "[seed, 1]": ONE_INDEX | {"calibration-session", "drift-prints"},
    "[seed, 2]": ONE_INDEX | {"bootstrap"},
    "[seed, 9]": ONE_INDEX | {"drum-faults"},
    "[seed, FREE + 19]": {
        "camera-noise",
        "gate-plan",
    },  # of two studies, which were measured beside each other
    "[seed, FREE + 60, n]": {"asked-sheets", "content-text"},  # only for a size of 0 points, which is none
    "[seed, FREE + 61, n]": {"content-text-session", "feedback-weeks"},
    "[seed, n, 1]": {
        "piece-places",
        "session",
        "study-print",
        "world-print",
    },
    "[seed, n, 2]": OF_COPIES | {"running-print"},
    "[seed, n, 3]": OF_COPIES,
    "[seed, n, 4]": OF_COPIES | {"rich-black"},
    "[seed, n, 11]": OF_COPIES | {"training-session"},
    "[seed, n, 12]": OF_COPIES | {"training-print"},
    "[seed, 0, 0, 0, 1]": {"ink-noise", "sample-job", "study-session"},
}
"""Purposes that meet, by where. A purpose whose seed is fixed meets them where the user's seed is that number."""

SPAWNING = {"ink-noise", "sample-job"}
"""Purposes whose stream has children."""


def test_no_stream_has_moved() -> None:
    assert set(FIRST_DRAWS) == set(PURPOSES)
    drawn = {
        name: int(stream(given[0], name, *given[1:]).integers(2**63))
        for name, (given, _) in FIRST_DRAWS.items()
    }
    assert drawn == {name: first for name, (_, first) in FIRST_DRAWS.items()}


def test_no_two_purposes_have_a_word_that_no_index_reaches_in_common() -> None:
    words = [each.layout[1] for each in PURPOSES.values() if len(each.layout) > 1]
    free = [word for word in words if isinstance(word, int) and word >= FREE]
    assert {word for word in free if free.count(word) > 1} == {
        FREE + 19,
        FREE + 60,
        FREE + 61,
    }  # KNOWN_SHARED


def test_purposes_stand_in_order_and_cannot_be_changed() -> None:
    assert list(PURPOSES) == sorted(PURPOSES)
    with pytest.raises(TypeError):
        PURPOSES["another"] = PURPOSES["print"]  # type: ignore[index]


@pytest.mark.parametrize(
    ("seed", "purpose", "indices", "why"),
    [
        (1, "prints", (1,), "there is no stream 'prints'"),
        (1, "print", (), r"'print' takes \('sheet',\) in addition to the seed, not \(\)"),
        (1, "print", (1, 2), r"'print' takes \('sheet',\) in addition to the seed, not \(1, 2\)"),
        (1, "session", (1,), r"'session' takes \(\) in addition to the seed"),
        (None, "print", (1,), "'print' takes a seed"),
        (2011, "dither", (), "'dither' has a fixed seed"),
        (-1, "print", (1,), "'print' counts from 0"),
        (1, "study-print", (1, -1), "'study-print' counts from 0"),
    ],
)
def test_what_no_stream_is_for_is_refused(
    seed: int | None, purpose: str, indices: tuple[int, ...], why: str
) -> None:
    with pytest.raises(ValueError, match=why):
        stream(seed, purpose, *indices)


def test_a_seed_that_is_no_whole_number_is_a_wrong_type() -> None:
    with pytest.raises(TypeError):
        stream(1.5, "specimen")  # type: ignore[arg-type]


def test_streams_of_neighbours_differ() -> None:
    near = [stream(seed, "study-print", design, copy) for seed, design, copy in product(range(3), repeat=3)]
    assert len({int(one.integers(2**63)) for one in near}) == len(near)


def test_only_known_purposes_share_a_stream() -> None:
    of_streams = defaultdict(set)
    for purpose, begun in _small_streams():
        for one in (begun, *(begun.spawn(3) if purpose in SPAWNING else ())):
            of_streams[tuple(one.generate_state(4).tolist())].add(purpose)
    found = {pair for sharing in of_streams.values() for pair in _pairs(sharing)}
    known = {pair for sharing in KNOWN_SHARED.values() for pair in _pairs(sharing) if not _of_two_seeds(pair)}
    assert found - known == set()
    assert known - found == set()


def _small_streams() -> Iterator[tuple[str, np.random.SeedSequence]]:
    """Over every number that is fixed somewhere, and those that come before it where an index counts from 1 or 2."""
    words = {word for each in PURPOSES.values() for word in each.layout[1:] if isinstance(word, int)}
    fixed = {word for word in words if word < FREE}
    numbers = sorted({max(number - before, 0) for number in fixed for before in range(3)})
    seeds = {3} | {each.layout[0] for each in PURPOSES.values() if not each.seeded}
    for name, purpose in PURPOSES.items():
        for seed in seeds if purpose.seeded else [None]:
            for indices in product(numbers, repeat=len(purpose.indices)):
                yield name, np.random.SeedSequence(seed_sequence(seed, name, *indices))


def _pairs(purposes: Iterable[str]) -> Iterator[tuple[str, str]]:
    return combinations(sorted(purposes), 2)


def _of_two_seeds(pair: Iterable[str]) -> bool:
    return len({PURPOSES[name].layout[0] for name in pair if not PURPOSES[name].seeded}) > 1


def test_no_generator_begins_elsewhere() -> None:
    elsewhere = [
        f"{path.name}:{line} {what}"
        for path, tree in _modules()
        if path != Path(rng.__file__)
        for line, what in _begun(tree)
    ]
    assert elsewhere == []
    assert "default_rng" in {what for _, what in _begun(ast.parse(Path(rng.__file__).read_text()))}


@pytest.mark.parametrize(
    "code",
    [
        "np.random.default_rng(1)",
        "numpy.random.SeedSequence([1])",
        "from numpy.random import default_rng",
        "from numpy import random",
        "import numpy.random",
        "import random",
        "from random import Random",
        "np.random.RandomState(1)",
        "np.random.normal()",
    ],
)
def test_a_generator_that_begins_elsewhere_is_seen(code: str) -> None:
    assert list(_begun(ast.parse(code)))


@cache
def _modules() -> list[tuple[Path, ast.Module]]:
    return [(path, ast.parse(path.read_text())) for room in ROOMS for path in sorted(room.rglob("*.py"))]


def _begun(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Lines that reach for random numbers by another way than a generator that is passed on."""
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(value=ast.Attribute(attr="random"), attr=name) if name != "Generator":
                yield node.lineno, name
            case ast.Import(names=names):
                yield from (
                    (node.lineno, one.name) for one in names if one.name in ("random", "numpy.random")
                )
            case ast.ImportFrom(module="random" | "numpy.random"):
                yield node.lineno, node.module
            case ast.ImportFrom(module="numpy", names=names):
                yield from ((node.lineno, one.name) for one in names if one.name == "random")


def test_each_purpose_is_drawn_for_and_each_call_names_one() -> None:
    called = set()
    for path, tree in _modules():
        for node in ast.walk(tree):
            match node:
                case ast.Call(
                    func=ast.Name(id="stream"), args=[_, ast.Constant(value=str(purpose)), *indices]
                ):
                    assert len(indices) == len(PURPOSES[purpose].indices), f"{path}:{node.lineno}"
                    called.add(purpose)
                case ast.Call(func=ast.Name(id="stream")):
                    pytest.fail(f"{path}:{node.lineno} names no purpose")
    assert called == set(PURPOSES)
