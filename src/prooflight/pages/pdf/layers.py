"""Layers (optional content, ISO 32000-2, 8.11) in their state for printing.

MuPDF hides layers by a usage for printing although nothing requests that the usage count, shows no layer that
is printed only, evaluates no expressions, and takes most policies for others. The state of each layer for
printing is therefore computed here, and written into the document in memory where MuPDF reads it.

Imported late, by ``document`` only: it needs PyMuPDF at import.
"""

from __future__ import annotations

from typing import Any

from pymupdf import mupdf

from prooflight.pages.pdf.resources import get, items, name_of

DEPTH_MAX = 32
"""Deepest nesting of expressions of visibility."""


class PrintedLayers:
    """Layers of a document, with whether each is printed."""

    def __init__(self, document: Any) -> None:
        """Read ``document``, a ``mupdf.PdfDocument``, whose default configuration becomes that for printing."""
        properties = get(get(mupdf.pdf_trailer(document), "Root"), "OCProperties")
        groups, default = items(get(properties, "OCGs")), get(properties, "D")
        self._printed = dict.fromkeys(
            map(mupdf.pdf_to_num, groups), name_of(get(default, "BaseState")) != "OFF"
        )
        for key, printed in (("ON", True), ("OFF", False)):
            self._printed |= dict.fromkeys(map(mupdf.pdf_to_num, items(get(default, key))), printed)
        self._apply_usage(default)
        for group in groups:
            if not self._has_intent(group, default):
                self._printed[mupdf.pdf_to_num(group)] = True
        if groups and default is not None:
            self._write(document, default, groups)

    def correct(self, membership: Any) -> None:
        """Simplify a membership dictionary (8.11.2.2) to whether its content is printed."""
        if name_of(get(membership, "Type")) != "OCMD":
            return
        expression, given = get(membership, "VE"), get(membership, "OCGs")
        if expression is not None:
            printed = self._value(expression, DEPTH_MAX)
        else:
            states = [self._value(group, 1) for group in items(given) or [given] if group is not None]
            policy = name_of(get(membership, "P")) or "AnyOn"
            wanted = [state == policy.endswith("On") for state in states]
            printed = not states or (all(wanted) if policy.startswith("All") else any(wanted))
        for key in ("VE", "OCGs"):
            mupdf.pdf_dict_dels(membership, key)
        # Without groups, all of them are on, and not all of them are off.
        mupdf.pdf_dict_puts(membership, "P", mupdf.pdf_new_name("AnyOn" if printed else "AllOff"))

    def _apply_usage(self, default: Any) -> None:
        """Apply usage where an application dictionary names it for the event of printing (8.11.4.4)."""
        for asked in items(get(default, "AS")):
            if name_of(get(asked, "Event")) != "Print":
                continue
            for group in items(get(asked, "OCGs")):
                states = set[str]()
                for category in map(name_of, items(get(asked, "Category"))):
                    states.add(name_of(get(get(get(group, "Usage"), category), f"{category}State")))
                if states & {"ON", "OFF"}:
                    self._printed[mupdf.pdf_to_num(group)] = "OFF" not in states

    @staticmethod
    def _has_intent(group: Any, default: Any) -> bool:
        """Return whether a layer's state counts: one of its intents is one of the configuration's (8.11.2.1)."""

        def intents(holder: Any) -> set[str]:
            given = get(holder, "Intent")
            return {"View"} if given is None else {name_of(given), *map(name_of, items(given))} - {""}

        return "All" in intents(default) or bool(intents(group) & intents(default))

    def _write(self, document: Any, default: Any, groups: list[Any]) -> None:
        hidden = mupdf.pdf_new_array(document, len(groups))
        for group in groups:
            for key in ("Usage", "Intent"):
                mupdf.pdf_dict_dels(group, key)
            if not self._printed[mupdf.pdf_to_num(group)]:
                mupdf.pdf_array_push(hidden, group)
        for key in ("BaseState", "ON", "AS", "Intent"):
            mupdf.pdf_dict_dels(default, key)
        mupdf.pdf_dict_puts(default, "OFF", hidden)
        mupdf.pdf_select_layer_config(document, -1)  # it may have been read before

    def _value(self, expression: Any, depth: int) -> bool:
        """Return the value of an expression of visibility (8.11.2.2); a layer that is not listed is visible."""
        operands = items(expression)
        if not operands or not depth:
            return self._printed.get(mupdf.pdf_to_num(expression), True)
        values = [self._value(one, depth - 1) for one in operands[1:]]
        operator = name_of(operands[0])
        if operator == "Not":
            return not any(values)
        return any(values) if operator == "Or" else all(values)
