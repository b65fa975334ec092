"""Words of invented languages in real scripts: every design has its own vocabulary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from prooflight.simulation.corpus.designs.chance import count, often, pick, pick_weighted, some
from prooflight.simulation.corpus.designs.faces import Face, OutlineFace, StrokeFace

SCRIPTS = {
    "latin": 70.0,
    "cyrillic": 9.0,
    "greek": 6.0,
    "arabic": 4.0,
    "ideographs": 4.0,
    "hebrew": 3.0,
    "armenian": 2.0,
    "georgian": 2.0,
}
"""Shares of designs; assumed: mostly Latin, and enough of the others that no detector overfits to letters."""
FROM_RIGHT = ("arabic", "hebrew")
_LETTERS = {  # onsets, vowels, codas; the empty string is one of them where syllables may lack that part
    "latin": (
        "b br c ch d dr f fl g gr h j k l m n p pr qu r s sh st t th tr v w z",
        "a e i o u ai ea ou é ö ü å",
    ),
    "cyrillic": ("б в г д ж з к л м н п р с т ф х ц ч ш щ", "а е и о у ы э ю я ё"),
    "greek": ("β γ δ ζ θ κ λ μ ν ξ π ρ σ τ φ χ ψ", "α ε η ι ο υ ω ά έ ή ί ό"),
    "hebrew": ("ב ג ד ה ז ח ט כ ל מ נ ס פ צ ק ר ש ת", "א ו י ע"),
    "armenian": ("բ գ դ զ թ ժ լ խ կ հ ձ ղ ճ մ ն շ պ ջ ռ ս վ տ ր ց փ ք", "ա ե է ը ի ո օ"),
    "georgian": ("ბ გ დ ვ ზ თ კ ლ მ ნ პ ჟ რ ს ტ ფ ქ ღ ყ შ ჩ ც ძ წ ჭ ხ ჯ ჰ", "ა ე ი ო უ"),
}
_CODAS = {"latin": "n r s t l m nd st ck x", "cyrillic": "н р с т л м к й ь", "greek": "ς ν ρ"}
_ARABIC_JOINING: tuple[int, ...] = (
    *(0xFE8F, 0xFE95, 0xFE99, 0xFE9D, 0xFEA1, 0xFEA5, 0xFEB1, 0xFEB5, 0xFEB9),
    *(0xFEC9, 0xFED1, 0xFED5, 0xFED9, 0xFEDD, 0xFEE1, 0xFEE5, 0xFEE9, 0xFEF1),
)
"""First of four presentation forms (isolated, final, initial, medial) of letters that join on both sides."""
_ARABIC_ENDING = (0xFE8D, 0xFEA9, 0xFEAB, 0xFEAD, 0xFEAF, 0xFEED)
"""First of two forms (isolated, final) of letters after which a new run begins."""
SANS, SERIF, MONO = "DejaVuSans", "DejaVuSerif", "DejaVuSansMono"
_BOLD_AND_ITALIC = {
    SANS: ("DejaVuSans-Bold", "DejaVuSans-Oblique"),
    SERIF: ("DejaVuSerif-Bold", "DejaVuSerif-Italic"),
    MONO: ("DejaVuSansMono-Bold", "DejaVuSansMono-Oblique"),
    "STIXGeneral": ("STIXGeneralBol", "STIXGeneralItalic"),
    "cmr10": ("cmb10", "cmti10"),
    "cmss10": ("DejaVuSans-Bold", "DejaVuSans-Oblique"),
    "cmtt10": ("DejaVuSansMono-Bold", "DejaVuSansMono-Oblique"),
}
_FACES = {
    "latin": {
        "STIXGeneral": 4.0,
        SANS: 4.0,
        SERIF: 2.0,
        MONO: 0.7,
        "cmr10": 1.3,
        "cmss10": 1.0,
        "cmtt10": 0.3,
    },
    "cyrillic": {"STIXGeneral": 2.0, SANS: 3.0, SERIF: 2.0, MONO: 0.5},
    "greek": {"STIXGeneral": 2.0, SANS: 3.0, SERIF: 2.0},
    "armenian": {SANS: 1.0, SERIF: 1.0},
    "georgian": {SANS: 1.0, SERIF: 1.0},
    "arabic": {SANS: 1.0},
    "hebrew": {SANS: 1.0},
}
_COMPUTER_MODERN_LACKS = str.maketrans("éöüå", "eoua")


@dataclass(frozen=True, slots=True, kw_only=True)
class Voice:
    """Vocabulary, script and faces of a design's words."""

    script: str
    vocabulary: tuple[str, ...]
    """Vocabulary, the most frequent words first."""
    face: Face
    bold: Face
    italic: Face
    figures: Face
    """Face for digits and codes."""

    @property
    def from_right(self) -> bool:
        """Return whether lines begin at the right."""
        return self.script in FROM_RIGHT

    def vocabulary_sample(self, rng: np.random.Generator, number: int) -> list[str]:
        """Draw words by Zipf's law, frequency in proportion to rank to the power of -1."""
        weights = 1.0 / np.arange(2, len(self.vocabulary) + 2)
        drawn = rng.choice(len(self.vocabulary), size=number, p=weights / weights.sum())
        return [self.vocabulary[place] for place in drawn]

    def prose(self, rng: np.random.Generator, number: int) -> list[str]:
        """Draw sentences of ``number`` words in all, now and then with a number in them."""
        words = self.vocabulary_sample(rng, number)
        left = 0
        for place, word in enumerate(words):
            if rng.random() < 0.015:
                words[place] = self.number(rng)
            if left == 0:
                words[place] = _capital(word)
                left = count(rng, 5, 22)
            left -= 1
            stop = "." if left == 0 or place == number - 1 else "," if rng.random() < 0.07 else ""
            words[place] = stop + words[place] if self.from_right else words[place] + stop
        return words

    def title(self, rng: np.random.Generator, least: int = 1, most: int = 4) -> str:
        """Draw a few words for a heading."""
        drawn = rng.choice(len(self.vocabulary), size=count(rng, least, most), replace=False)
        words = [self.vocabulary[place] for place in drawn]
        words = [_capital(words[0]), *(_capital(word) if len(word) > 4 else word for word in words[1:])]
        return " ".join(reversed(words) if self.from_right else words)

    def number(self, rng: np.random.Generator) -> str:
        """Draw a number of one to six digits."""
        return str(count(rng, 1, 10 ** count(rng, 1, 6) - 1))

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Voice:
        """Draw a script, a vocabulary and faces."""
        script = pick_weighted(rng, SCRIPTS)
        if script == "ideographs":
            face = StrokeFace.draw(rng)
            words = tuple(
                "".join(pick(rng, face.letters) for _ in range(count(rng, 1, 4))) for _ in range(160)
            )
            figures = OutlineFace(SANS)
            return cls(script=script, vocabulary=words, face=face, bold=face, italic=face, figures=figures)
        stem = pick_weighted(rng, _FACES[script])
        words = _vocabulary(rng, script)
        if stem.startswith("cm"):
            words = tuple(word.translate(_COMPUTER_MODERN_LACKS) for word in words)
        bold, italic = _BOLD_AND_ITALIC[stem]
        return cls(
            script=script,
            vocabulary=words,
            face=OutlineFace(stem),
            bold=OutlineFace(bold),
            italic=OutlineFace(stem if script in FROM_RIGHT else italic),
            figures=OutlineFace(pick(rng, (stem, SANS, MONO))),
        )


def _vocabulary(rng: np.random.Generator, script: str) -> tuple[str, ...]:
    if script == "arabic":
        return tuple(_arabic_word(rng) for _ in range(180))
    onsets, vowels = (_part(rng, letters.split(), 0.7) for letters in _LETTERS[script])
    codas = _part(rng, _CODAS.get(script, "").split(), 0.6)
    coda_share = some(rng, 0.15, 0.5) if codas else 0.0
    words = []
    for rank in range(220):
        syllables = 1 if rank < 14 else count(rng, 1, 4)
        word = ""
        for _ in range(syllables):
            word += pick(rng, onsets) + pick(rng, vowels)
            if often(rng, coda_share):
                word += pick(rng, codas)
        words.append(word[::-1] if script == "hebrew" else word)
    return tuple(dict.fromkeys(words))


def _part(rng: np.random.Generator, letters: Sequence[str], share: float) -> list[str]:
    chosen = [letter for letter in letters if rng.random() < share]
    return chosen or list(letters)


def _arabic_word(rng: np.random.Generator) -> str:
    """Return shaped letters in the order of drawing, from the left: presentation forms need no shaping engine."""
    letters = [
        pick(rng, _ARABIC_ENDING) if often(rng, 0.35) else pick(rng, _ARABIC_JOINING)
        for _ in range(count(rng, 2, 7))
    ]
    drawn, joined = "", False
    for place, letter in enumerate(letters):
        goes_on = letter in _ARABIC_JOINING and place < len(letters) - 1
        form = int(joined) if not goes_on else 3 if joined else 2
        drawn = chr(letter + form) + drawn
        joined = goes_on
    return drawn


def _capital(word: str) -> str:
    """Return the word with a capital; Georgian has none in the faces used, other scripts have none at all."""
    return word if "\u10a0" <= word[:1] <= "\u10ff" else word[:1].upper() + word[1:]
