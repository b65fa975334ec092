"""Arguments and options that several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from prooflight.detectors.registry import names

Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Profile = Annotated[
    Path | None, typer.Option(metavar="ICC", help="CMYK profile for colours that are not CMYK.")
]
PressArtefact = Annotated[Path, typer.Option("--press", metavar="X.press", help="Press artefact.")]
Pages = Annotated[str | None, typer.Option(metavar="1,4-6", help="Pages; default all.")]
JobPath = Annotated[Path, typer.Argument(metavar="JOB", help="PDF, CMYK TIFF or JPEG, or a folder of them.")]
LayoutOption = Annotated[
    str | None,
    typer.Option(
        "--layout",
        metavar="WORDS",
        help="Imposition of pages on sheets, e.g. sides=2,n-up=2x1,pages-a-set=8; default one page per sheet.",
    ),
]
Detector = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Detector: matched_filter; the paper's learned one, bayes, or its statistical one, chi-square; golden, by "
        "--golden; packages may register others. "
        f"Available: {', '.join(names())}. Default: matched_filter if the press was trained with it, else chi-square.",
    ),
]
ClusterAt = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        metavar="local:N|tcp://HOST:PORT",
        help="Workers that share the work: N processes on this machine, or those of a Dask scheduler.",
    ),
]
OnDevice = Annotated[
    Literal["cpu", "gpu"],  # detectors.base.Device, which would load numpy for --help
    typer.Option(
        "--device",
        help="Where the matched filter computes the images of a scan: cpu, or gpu, an NVIDIA card (prooflight[gpu]).",
    ),
]
Seed = Annotated[int, typer.Option(help="Seed of all random numbers.", min=0, max=2**32 - 1)]
Zones = Annotated[
    Path | None,
    typer.Option(
        metavar="F.json", help="Zones of the job's pages, priced on this press: `prooflight zones price`."
    ),
]
