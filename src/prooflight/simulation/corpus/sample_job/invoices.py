"""Run of invoices: one design, six addressees, amounts that add up, bar codes on the 0.1 mm grid."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

from reportlab.graphics.barcode import code128, qrencoder
from reportlab.lib.units import mm

from prooflight.simulation.corpus.sample_job import faces, inks, quay
from prooflight.simulation.corpus.sample_job.sheet import LEFT_MM, RIGHT_MM, Sheet, column

if TYPE_CHECKING:
    import numpy as np


COPIES = 6
VAT_PERCENT = 20
_CARRIAGE_PENCE = 695
_CARRIAGE_FREE_PENCE = 50000
_QR_VERSION = 2  # 25 modules a side, up to 26 bytes at error correction level M (ISO/IEC 18004, table 7)
_QR_MODULES = 4 * _QR_VERSION + 17


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """Position of an invoice."""

    code: str
    what: str
    bag: str
    quantity: int
    unit_pence: int

    @property
    def pence(self) -> int:
        """Return quantity times unit price."""
        return self.quantity * self.unit_pence


@dataclass(frozen=True, slots=True, kw_only=True)
class Invoice:
    """Copy of the run."""

    number: str
    """Number as printed, and as in both bar codes."""
    addressee: tuple[str, str, str, str]
    customer: str
    day: str
    due: str
    lines: tuple[Line, ...]

    @property
    def goods_pence(self) -> int:
        """Return the sum of the lines."""
        return sum(line.pence for line in self.lines)

    @property
    def carriage_pence(self) -> int:
        """Return the carriage, free from 500 pounds."""
        return 0 if self.goods_pence >= _CARRIAGE_FREE_PENCE else _CARRIAGE_PENCE

    @property
    def vat_pence(self) -> int:
        """Return the value-added tax on goods and carriage, rounded half up."""
        return ((self.goods_pence + self.carriage_pence) * VAT_PERCENT * 2 + 100) // 200

    @property
    def total_pence(self) -> int:
        """Return the amount to be paid."""
        return self.goods_pence + self.carriage_pence + self.vat_pence


def draw_up(lots: tuple[quay.Lot, ...], rng: np.random.Generator) -> tuple[Invoice, ...]:
    """Draw up six invoices with consecutive numbers."""
    first = int(rng.integers(2000, 9000))
    invoices = []
    for place, who in enumerate(rng.permutation(len(quay.CUSTOMERS))[:COPIES]):
        lines = tuple(
            _line(lots[int(lot)], rng) for lot in rng.permutation(len(lots))[: int(rng.integers(4, 10))]
        )
        day = 3 + place
        invoices.append(
            Invoice(
                number=f"QSR-{first + place:06d}",
                addressee=quay.CUSTOMERS[int(who)],
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
    """Draw one invoice on one page."""
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
    quay.address(sheet, invoice.addressee)


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


_EDGES_MM = (LEFT_MM, 28.0, 46.0, 144.0, 168.0, RIGHT_MM)


def _table(sheet: Sheet, invoice: Invoice) -> float:
    y = 115.0
    heads = ("No.", "Code", "Coffee", "Bags", "Each £", "Amount £")
    quay.row(sheet, y, _EDGES_MM, heads, faces.SANS_BOLD, 6.8, quay.TEAL)
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
        quay.row(sheet, y, _EDGES_MM, cells, faces.SANS, 7.6, inks.BLACK)
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


def _slip(sheet: Sheet, invoice: Invoice) -> None:
    top = 238.0
    sheet.canvas.setDash(2, 2)
    sheet.rule(0, top - 5, 210, top - 5, inks.GREY, 0.4)
    sheet.canvas.setDash()
    sheet.label(LEFT_MM, top - 7, "Please return with your payment")
    side = _square_code(sheet, LEFT_MM, top + 6, invoice.number)
    x = column(1)[0] + 4
    sheet.text(x, top + 9, "Payment slip", faces.SERIF, 14, ink=quay.TEAL)
    facts = (*invoice.addressee[:2], f"Customer {invoice.customer}", f"Payable by {invoice.due}")
    for place, text in enumerate(facts):
        sheet.text(x, top + 14 + 4 * place, text, faces.SANS, 7.0)
    sheet.text(x, top + 6 + side, f"£ {quay.money(invoice.total_pence)}", faces.SANS_BOLD, 11)
    bars = column(3)[0] + 14
    _bar_code(sheet, bars, top + 6, invoice.number)
    sheet.text(bars, top + 6 + side, invoice.number, faces.MONO, 9, spread_pt=1.2)


def _bar_code(
    sheet: Sheet, x: float, y: float, text: str, *, module_mm: float = 0.4, height_mm: float = 20.0
) -> None:
    """Draw Code 128 (ISO/IEC 15417) with its first bar at x and its top edge at y."""
    code = code128.Code128(
        text,
        barWidth=module_mm * mm,
        barHeight=height_mm * mm,
        quiet=0,
        humanReadable=0,
        barFillColor=inks.colour(inks.BLACK),
    )
    code.drawOn(sheet.canvas, *sheet.at(x, y + height_mm))


def _square_code(sheet: Sheet, x: float, y: float, text: str, *, module_mm: float = 1.1) -> float:
    """Draw a QR code (ISO/IEC 18004) with its corner at (x, y), without quiet zone; return its side. [mm]"""
    code = qrencoder.QRCode(_QR_VERSION, qrencoder.QRErrorCorrectLevel.M)
    code.addData(text)
    code.make()
    for row in range(_QR_MODULES):
        dark = [bool(code.isDark(row, step)) for step in range(_QR_MODULES)]
        for is_dark, run in groupby(range(_QR_MODULES), dark.__getitem__):
            if is_dark:
                first, *more = run
                wide = (1 + len(more)) * module_mm
                sheet.rect(x + first * module_mm, y + row * module_mm, wide, module_mm, inks.BLACK)
    return _QR_MODULES * module_mm
