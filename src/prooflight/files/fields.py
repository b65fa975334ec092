"""Types of the fields of a press file: strict, so that text and booleans are no numbers."""

from __future__ import annotations

from typing import Annotated, Final

from pydantic import ConfigDict, Field

LEAST, GREATEST = 1e-9, 1e12
"""Nothing about a press is smaller or larger, in any of our units; so products of several stay finite."""
NO_OTHER_FIELDS: Final = ConfigDict(extra="forbid", frozen=True, defer_build=True)
"""Configuration of a block, or of a dataclass that is one: fields that it does not have are refused.

Its checks are built where it is read first, since a command reads few kinds of blocks.
"""

Positive = Annotated[float, Field(strict=True, ge=LEAST, le=GREATEST)]
NotNegative = Annotated[float, Field(strict=True, ge=0, le=GREATEST)]
Share = Annotated[float, Field(strict=True, ge=LEAST, le=1)]
Number = Annotated[float, Field(strict=True, ge=-1e6, le=1e6, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True, ge=1, le=100_000)]
Lead = Annotated[float, Field(strict=True, ge=0, le=10_000)]
"""Backing before or after a page. [mm]"""
Pitch = Annotated[float, Field(strict=True, ge=0.002, le=10)]
"""Extent of a pixel or a line on the page. [mm]"""
Flag = Annotated[bool, Field(strict=True)]
ShortText = Annotated[str, Field(strict=True, min_length=1, max_length=200)]
