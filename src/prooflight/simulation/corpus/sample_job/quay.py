"""Invented customer of the press: a coffee roastery, its house style and its stock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.simulation.corpus.sample_job import faces, inks
from prooflight.simulation.corpus.sample_job.sheet import LEFT_MM, RIGHT_MM, TOP_MM, Sheet

if TYPE_CHECKING:
    import numpy as np


NAME = "Quay Street Roasters"
ADDRESS = ("11 Quay Street", "Harrowick HK4 2QR")
CONTACT = ("orders@quaystreet.example", "quaystreet.example")

TEAL = inks.percent(88, 22, 42, 24)
BEAN = inks.percent(38, 66, 76, 52)
FOAM = inks.percent(3, 5, 12, 0)
APRICOT = inks.percent(0, 44, 72, 0)
LEAF = inks.percent(54, 12, 60, 6)

CUSTOMERS = (
    ("Ms Adaeze Okonkwo-Hale", "The Copper Kettle", "4 Weaver’s Row", "Thornby TB1 7LD"),
    ("Mr Søren Ågård", "Ågård & Daughters", "Flat 12, Lime Wharf", "Harrowick HK2 0AX"),
    ("Mrs Zofia Wójcik", "Piekarnia Zofia", "88 Station Parade", "Great Ember GE5 3JN"),
    ("Dr Iñigo Etxeberria", "Old Customs Hall", "1 Customs Square", "Harrowick HK4 1AA"),
    ("Ms Eleni Παπαδάκη", "Reading Room Café", "27 Chandler Street", "Saltmarsh SM9 4TE"),
    ("Mr Tomáš Křížek", "Hotel Lanterna", "Promenade 160–164", "Saltmarsh SM1 1LH"),
    ("Mx Robin Featherstonehaugh", "Five Loaves Bakery", "Unit 3, Gasworks Yard", "Thornby TB6 2PP"),
    ("Mrs Giulia D’Agostino", "Bar Centrale", "19 Market Place", "Little Ember GE2 8WS"),
)
"""Name, firm, street and town of its customers."""

_ORIGINS: tuple[tuple[str, str, str, tuple[int, int], int], ...] = (
    # country, code, lots, altitude range [m], pence for 250 g of an ordinary lot
    ("Brazil", "BR", "Serra Clara/Fazenda do Lago/Vale Verde/Pedra Alta/Boa Sombra", (900, 1250), 690),
    ("Colombia", "CO", "El Mirador/La Niebla/Río Sucio/Los Tres Primos/Alto Bonito", (1500, 2000), 840),
    ("Costa Rica", "CR", "Finca Lluvia/Cerro Quieto/Doña Inés/Las Piñuelas", (1250, 1800), 890),
    (
        "Ethiopia",
        "ET",
        "Weyra Hill/Lower Kello/Dembi Station/Anasora Heirloom/Buna Washed",
        (1850, 2300),
        960,
    ),
    ("Guatemala", "GT", "San Telmo/La Bruma/El Zapote/Tres Volcanes", (1450, 1900), 880),
    ("Indonesia", "ID", "Blue Lintang/Tanah Hitam/Gunung Sari/Danau Kecil", (1150, 1550), 820),
    ("Kenya", "KE", "Mugaa AB/Kiruri AA/Ndima Peaberry/Upper Thiri AB", (1600, 1950), 980),
    ("Peru", "PE", "Quebrada Honda/Agua Fría/Mil Nubes", (1350, 1850), 790),
    ("Rwanda", "RW", "Lake Shore Fully Washed/Nyara Natural/Hill Seven", (1550, 2050), 870),
)
_PROCESSES = ("washed", "natural", "honey", "pulped natural", "anaerobic")


@dataclass(frozen=True, slots=True, kw_only=True)
class Lot:
    """Coffee on the price list."""

    code: str
    country: str
    name: str
    process: str
    altitude_m: int
    cupping_score: float
    pence_250g: int

    def pence(self, grams: int) -> int:
        """Return the price of a bag; the larger the bag, the less a gram costs, to whole ten pence."""
        discount = {250: 1.0, 1000: 0.92, 5000: 0.85, 15000: 0.79}[grams]
        return round(self.pence_250g * grams / 250 * discount / 10) * 10


BAGS_G = (250, 1000, 5000, 15000)


def stock(rng: np.random.Generator) -> tuple[Lot, ...]:
    """Draw the season's lots, country by country."""
    lots = []
    for country, code, names, (low, high), pence in _ORIGINS:
        for place, name in enumerate(names.split("/")):
            lots.append(
                Lot(
                    code=f"{code}-{rng.integers(100, 1000) // 10:02d}{place}",
                    country=country,
                    name=name,
                    process=_PROCESSES[int(rng.choice(5, p=(0.42, 0.26, 0.16, 0.1, 0.06)))],
                    altitude_m=int(rng.integers(low // 10, high // 10 + 1)) * 10,
                    cupping_score=float(rng.integers(330, 361)) / 4,
                    pence_250g=round(pence * float(rng.uniform(0.92, 1.28)) / 10) * 10,
                )
            )
    return tuple(lots)


def money(pence: int) -> str:
    """Return pounds with thousands set off by a comma.

    >>> money(123456)
    '1,234.56'
    """
    return f"{pence // 100:,}.{pence % 100:02d}"


def mark(
    sheet: Sheet, x: float, y: float, size: float, ink: inks.Ink = TEAL, letter: inks.Ink = inks.PAPER
) -> None:
    """Draw the house mark, a reversed Q in a disc, with its box's corner at (x, y). [mm]"""
    sheet.circle(x + size / 2, y + size / 2, size / 2, ink)
    sheet.text(x + size / 2, y + size * 0.72, "Q", faces.SERIF, size * 1.95, ink=letter, align="centre")


def address(sheet: Sheet, lines: tuple[str, ...]) -> None:
    """Set an address where a window envelope shows it."""
    for place, text in enumerate(lines):
        sheet.text(LEFT_MM, 63 + 5.2 * place, text, faces.SERIF, 11.4)


def row(
    sheet: Sheet,
    y: float,
    edges_mm: tuple[float, ...],
    cells: tuple[str, ...],
    face: str,
    size_pt: float,
    ink: inks.Ink,
) -> None:
    """Set a row of a table: three columns of words, which begin at their edge, and numbers, which end at theirs."""
    for place, (edge, text) in enumerate(zip(edges_mm, cells, strict=True)):
        sheet.text(edge, y, text, face, size_pt, ink=ink, align="left" if place < 3 else "right")


def letterhead(sheet: Sheet) -> None:
    """Draw mark and name on the left, address on the right, at the top of a commercial page."""
    mark(sheet, LEFT_MM, TOP_MM, 14)
    sheet.text(LEFT_MM + 18, TOP_MM + 6.6, NAME, faces.SERIF, 15, ink=TEAL)
    sheet.label(LEFT_MM + 18, TOP_MM + 12, "Coffee since 1987")
    for place, line in enumerate((*ADDRESS, *CONTACT)):
        sheet.text(RIGHT_MM, TOP_MM + 2.4 + 3.9 * place, line, faces.SANS, 6.8, ink=inks.GREY, align="right")
