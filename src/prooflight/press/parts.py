"""``[press]`` of a press file: the rollers and print heads by which the cause of a defect is named."""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from pydantic import BaseModel, Field, model_validator

from prooflight.files.fields import NO_OTHER_FIELDS

UM_PER_MM: Final = 1000.0
Name = Annotated[str, Field(strict=True, min_length=1, max_length=100)]
Circumference = Annotated[float, Field(strict=True, ge=20, le=20_000)]
"""A roller of 6 mm to a belt of 20 m."""
Pitch = Annotated[float, Field(strict=True, ge=1, le=2000)]
Place = Annotated[float, Field(strict=True, ge=-10_000, le=10_000)]


class _Block(BaseModel):
    model_config = NO_OTHER_FIELDS


class RollerBlock(_Block):
    """One ``[[press.rollers]]``: a roller, drum or belt that touches the paper or the image."""

    name: Name
    circumference_mm: Circumference
    """Length of paper that passes in one turn."""
    tolerance_percent: Annotated[float, Field(strict=True, gt=0, le=5)] = 0.3
    """Uncertainty of that length. assumed: wear, and slip between roller and paper, are thousandths."""

    @property
    def tolerance_mm(self) -> float:
        """Return the uncertainty of the circumference."""
        return self.circumference_mm * self.tolerance_percent / 100


class HeadBlock(_Block):
    """One ``[[press.heads]]``: a print head, or a bar of heads whose nozzles are counted through."""

    name: Name
    ink: Literal["C", "M", "Y", "K", ""] = ""
    """Letter of its ink; empty: not stated."""
    first_nozzle_mm: Place
    """Place of the line that nozzle 1 prints, from the left edge of the printed page, to the right."""
    nozzle_pitch_um: Pitch
    nozzles: Annotated[int, Field(strict=True, ge=1, le=1_000_000)]

    def nozzle_at(self, x_mm: float) -> float:
        """Return the number of the nozzle at a place, from 1, as a real number."""
        return 1 + (x_mm - self.first_nozzle_mm) * UM_PER_MM / self.nozzle_pitch_um


class PartsBlock(_Block):
    """``[press]``."""

    rollers: Annotated[tuple[RollerBlock, ...], Field(max_length=200)] = ()
    heads: Annotated[tuple[HeadBlock, ...], Field(max_length=200)] = ()

    @model_validator(mode="after")
    def _named_once(self) -> Self:
        for what, named in (("rollers", self.rollers), ("heads", self.heads)):
            names = [one.name for one in named]
            if repeated := next((name for name in names if names.count(name) > 1), None):
                message = f"{what} has two of the name {repeated!r}"
                raise ValueError(message)
        return self
