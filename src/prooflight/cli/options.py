"""Arguments and options that several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from prooflight.inspection.registry import names

Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Profile = Annotated[
    Path | None, typer.Option(metavar="ICC", help="CMYK profile for colours that are not CMYK.")
]
PressArtefact = Annotated[Path, typer.Option("--press", metavar="X.press", help="Press artefact.")]
Pages = Annotated[str | None, typer.Option(metavar="1,4-6", help="Pages; default all.")]
JobPath = Annotated[Path, typer.Argument(metavar="JOB", help="PDF, CMYK TIFF or JPEG, or a folder of them.")]
Detector = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="ours; bayes and chi-square: the paper's learned and statistical ones; packages may register others. "
        f"Known here: {', '.join(names())}. Default: ours if the press was taught it, else chi-square.",
    ),
]
Seed = Annotated[int, typer.Option(help="Of everything random.", min=0, max=2**32 - 1)]
