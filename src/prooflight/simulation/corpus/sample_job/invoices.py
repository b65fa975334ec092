"""A run of invoices: one design, six addressees, amounts that add up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.simulation.corpus.sample_job import codes, faces, inks, quay
from prooflight.simulation.corpus.sample_job.sheet import LEFT_MM, RIGHT_MM, column

if TYPE_CHECKING:
    import numpy as np

    from prooflight.simulation.corpus.sample_job.sheet import Sheet

COPIES = 6
VAT_PERCENT = 20
_CARRIAGE_PENCE = 695
_CARRIAGE_FREE_PENCE = 50000

_CUSTOMERS = (
    ("Ms Adaeze Okonkwo-Hale", "The Copper Kettle", "4 Weaver’s Row", "Thornby TB1 7LD"),
    ("Mr Søren Ågård", "Ågård & Daughters", "Flat 12, Lime Wharf", "Harrowick HK2 0AX"),
    ("Mrs Zofia Wójcik", "Piekarnia Zofia", "88 Station Parade", "Great Ember GE5 3JN"),
    ("Dr Iñigo Etxeberria", "Old Customs Hall", "1 Customs Square", "Harrowick HK4 1AA"),
    ("Ms Eleni Παπαδάκη", "Reading Room Café", "27 Chandler Street", "Saltmarsh SM9 4TE"),
    ("Mr Tomáš Křížek", "Hotel Lanterna", "Promenade 160–164", "Saltmarsh SM1 1LH"),
    ("Mx Robin Featherstonehaugh", "Five Loaves Bakery", "Unit 3, Gasworks Yard", "Thornby TB6 2PP"),
    ("Mrs Giulia D’Agostino", "Bar Centrale", "19 Market Place", "Little Ember GE2 8WS"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """One position of an invoice."""

    code: str
    what: str
    bag: str
    quantity: int
    unit_pence: int

    @property
    def pence(self) -> int:
        """Quantity times unit price."""
        return self.quantity * self.unit_pence


@dataclass(frozen=True, slots=True, kw_only=True)
class Invoice:
    """One copy of the run."""

    number: str
    """As printed, and as in both bar codes."""
    addressee: tuple[str, str, str, str]
    customer: str
    day: str
    due: str
    lines: tuple[Line, ...]

    @property
    def goods_pence(self) -> int:
        """Sum of the lines."""
        return sum(line.pence for line in self.lines)

    @property
    def carriage_pence(self) -> int:
        """Free from 500 pounds."""
        return 0 if self.goods_pence >= _CARRIAGE_FREE_PENCE else _CARRIAGE_PENCE

    @property
    def vat_pence(self) -> int:
        """Value-added tax on goods and carriage, rounded half up."""
        return ((self.goods_pence + self.carriage_pence) * VAT_PERCENT * 2 + 100) // 200

    @property
    def total_pence(self) -> int:
        """What is to be paid."""
        return self.goods_pence + self.carriage_pence + self.vat_pence


def draw_up(lots: tuple[quay.Lot, ...], rng: np.random.Generator) -> tuple[Invoice, ...]:
    """Six invoices with consecutive numbers."""
    first = int(rng.integers(2000, 9000))
    invoices = []
    for place, who in enumerate(rng.permutation(len(_CUSTOMERS))[:COPIES]):
        lines = tuple(
            _line(lots[int(lot)], rng) for lot in rng.permutation(len(lots))[: int(rng.integers(4, 10))]
        )
        day = 3 + place
        invoices.append(
            Invoice(
                number=f"QSR-{first + place:06d}",
                addressee=_CUSTOMERS[int(who)],
                customer=f"{rng.integers(10000, 100000)}",
                day=f"{day} March 2025",
                due=f"{day} April 2025",
                lines=lines,
            )
        )
    return tuple(invoices)


def _line(lot: quay.Lot, rng: np.random.Generator) -> Line:
    bag = int(rng.choice(3, p=(0.45, 0.4, 0.15)))
    grams = quay.BAGS_G[bag]
    return Line(
        code=lot.code,
        what=f"{lot.country}, {lot.name}",
        bag=("250 g", "1 kg", "5 kg")[bag],
        quantity=int(rng.integers(1, (17, 9, 3)[bag])),
        unit_pence=lot.pence(grams),
    )


def draw(sheet: Sheet, invoice: Invoice) -> None:
    """One invoice on one page."""
    sheet.begin(f"Invoice {invoice.number}")
    quay.letterhead(sheet)
    _address(sheet, invoice)
    _facts(sheet, invoice)
    sheet.text(LEFT_MM, 104, "Invoice", faces.SERIF, 24, ink=quay.TEAL)
    sheet.text(LEFT_MM + 36, 104, invoice.number, faces.SANS_BOLD, 10)
    y = _table(sheet, invoice)
    _totals(sheet, invoice, y)
    _slip(sheet, invoice)


def _address(sheet: Sheet, invoice: Invoice) -> None:
    sheet.text(LEFT_MM, 54, f"{quay.NAME}, {', '.join(quay.ADDRESS)}", faces.SANS, 5.4, ink=inks.GREY)
    sheet.rule(LEFT_MM, 55.4, LEFT_MM + 82, 55.4, inks.HAIRLINE, 0.3)
    for place, words in enumerate(invoice.addressee):
        sheet.text(LEFT_MM, 63 + 5.2 * place, words, faces.SERIF, 11.4)


def _facts(sheet: Sheet, invoice: Invoice) -> None:
    x, width = column(4, 2)
    facts = (
        ("Invoice", invoice.number),
        ("Customer", invoice.customer),
        ("Date", invoice.day),
        ("Payable by", invoice.due),
    )
    for place, (name, value) in enumerate(facts):
        y = 63 + 5.2 * place
        sheet.text(x, y, name, faces.SANS, 7.2, ink=inks.GREY)
        sheet.text(x + width, y, value, faces.SANS, 7.6, align="right")
        sheet.rule(x, y + 1.7, x + width, y + 1.7, inks.HAIRLINE, 0.3)


_EDGES_MM = (LEFT_MM, 28.0, 46.0, 118.0, 144.0, 168.0, RIGHT_MM)


def _row(sheet: Sheet, y: float, cells: tuple[str, ...], face: str, size_pt: float, ink: inks.Ink) -> None:
    position, code, what, bag, unit, amount = cells
    edges = _EDGES_MM
    sheet.text(edges[0], y, position, face, size_pt, ink=ink)
    sheet.text(edges[1], y, code, face, size_pt, ink=ink)
    sheet.text(edges[2], y, what, face, size_pt, ink=ink)
    sheet.text(edges[4], y, bag, face, size_pt, ink=ink, align="right")
    sheet.text(edges[5], y, unit, face, size_pt, ink=ink, align="right")
    sheet.text(edges[6], y, amount, face, size_pt, ink=ink, align="right")


def _table(sheet: Sheet, invoice: Invoice) -> float:
    y = 115.0
    _row(sheet, y, ("No.", "Code", "Coffee", "Bags", "Each £", "Amount £"), faces.SANS_BOLD, 6.8, quay.TEAL)
    sheet.rule(LEFT_MM, y + 2.4, RIGHT_MM, y + 2.4, quay.TEAL, 0.9)
    for place, line in enumerate(invoice.lines, 1):
        y += 7.0
        cells = (
            str(place),
            line.code,
            line.what,
            f"{line.quantity} × {line.bag}",
            quay.money(line.unit_pence),
            quay.money(line.pence),
        )
        _row(sheet, y, cells, faces.SANS, 7.6, inks.BLACK)
        sheet.rule(LEFT_MM, y + 2.4, RIGHT_MM, y + 2.4, inks.HAIRLINE, 0.3)
    return y


def _totals(sheet: Sheet, invoice: Invoice, y: float) -> None:
    x = column(3)[0]
    y += 2.0
    rows = (
        ("Goods", invoice.goods_pence),
        ("Carriage", invoice.carriage_pence),
        (f"VAT {VAT_PERCENT} %", invoice.vat_pence),
    )
    for name, pence in rows:
        y += 6.0
        sheet.text(x, y, name, faces.SANS, 7.6, ink=inks.GREY)
        sheet.text(RIGHT_MM, y, quay.money(pence), faces.SANS, 7.6, align="right")
    y += 4.0
    sheet.rect(x - 3, y, RIGHT_MM - x + 3, 9, quay.TEAL)
    sheet.text(x, y + 6, "To pay", faces.SANS_BOLD, 9, ink=inks.PAPER)
    total = f"£ {quay.money(invoice.total_pence)}"
    sheet.text(RIGHT_MM - 3, y + 6, total, faces.SANS_BOLD, 9, ink=inks.PAPER, align="right")
    sheet.know(x - 3, y, 2, 9, quay.TEAL)


def _slip(sheet: Sheet, invoice: Invoice) -> None:
    top = 238.0
    sheet.canvas.setDash(2, 2)
    sheet.rule(0, top - 5, 210, top - 5, inks.GREY, 0.4)
    sheet.canvas.setDash()
    sheet.label(LEFT_MM, top - 7, "Please return with your payment")
    side = codes.square(sheet, LEFT_MM, top + 6, invoice.number)
    x = column(1)[0] + 4
    sheet.text(x, top + 9, "Payment slip", faces.SERIF, 14, ink=quay.TEAL)
    facts = (*invoice.addressee[:2], f"Customer {invoice.customer}", f"Payable by {invoice.due}")
    for place, words in enumerate(facts):
        sheet.text(x, top + 14 + 4 * place, words, faces.SANS, 7.0)
    sheet.text(x, top + 6 + side, f"£ {quay.money(invoice.total_pence)}", faces.SANS_BOLD, 11)
    bars = column(3)[0] + 14
    codes.linear(sheet, bars, top + 6, invoice.number, module_mm=0.4, height_mm=20)
    sheet.text(bars, top + 6 + side, invoice.number, faces.MONO, 9, spread_pt=1.2)
