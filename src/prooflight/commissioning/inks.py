"""Inks in a press artefact: packed into plain arrays and texts, and rebuilt from them."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from prooflight.errors import PressError
from prooflight.files.ink_schema import OF_MODEL, OF_SPREAD, SPREAD
from prooflight.files.schema import part_of
from prooflight.inks.ink_model import InkModel, Spread
from prooflight.inks.reflectance import LogLinear, ReflectanceModel
from prooflight.inks.selection import MODELS, Score
from prooflight.press.artefact import REBUILD, Press

if TYPE_CHECKING:
    from numpy.typing import NDArray


def packed(inks: ReflectanceModel) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Pack inks into arrays and facts, for ``Press.ink_arrays`` and ``Press.ink_facts``.

    TypeError: inks that are neither log-linear (the built-in press) nor fitted to a chart.
    """
    match inks:
        case InkModel():
            arrays = {OF_MODEL + name: array for name, array in inks.model.arrays().items()}
            arrays |= {OF_SPREAD + name: getattr(inks.spread, name) for name in SPREAD}
            facts = {
                "name": inks.name,
                "model": inks.name,
                "chart_digest": inks.chart_digest,
                "score": json.dumps(asdict(inks.score), sort_keys=True),
                "why": inks.why,
            }
        case LogLinear():
            arrays = {OF_MODEL + name: array for name, array in inks.arrays().items()}
            facts = {"name": inks.name, "model": "log-linear"}
        case _:
            message = f"inks of type {type(inks).__name__} cannot be packed"
            raise TypeError(message)
    return arrays, facts


def inks_of(press: Press) -> ReflectanceModel:
    """Rebuild the inks that a press was made from; PressError if it carries none or unknown ones."""
    facts = press.ink_facts
    if not (facts and press.ink_arrays):
        raise PressError(f"press {press.name}", "carries no inks", remedy=REBUILD)
    press.check()
    model = MODELS[facts["model"]].from_arrays(part_of(press.ink_arrays, OF_MODEL))
    if "score" in facts:
        return InkModel(
            model=model,
            spread=Spread(**part_of(press.ink_arrays, OF_SPREAD)),
            score=Score(**json.loads(facts["score"])),
            why=facts["why"],
            chart_digest=facts["chart_digest"],
        )
    return replace(model, name=facts["name"]) if isinstance(model, LogLinear) else model
