"""HTML templates in this folder, and pictures embedded in a page."""

from __future__ import annotations

import base64
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from prooflight.reporting import wording


@cache
def template(name: str) -> Template:
    """Return the template ``name``.html.j2, which has access to ``wording``."""
    environment = Environment(
        loader=PackageLoader("prooflight.reporting", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["wording"] = wording
    return environment.get_template(f"{name}.html.j2")


def data_uri(picture: bytes, kind: str) -> str:
    """Return a picture (png, webp) as a data URI."""
    return f"data:image/{kind};base64," + base64.b64encode(picture).decode("ascii")
