"""The workers of ``--cluster``, as long as a command runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from prooflight.errors import RequestError

if TYPE_CHECKING:
    from prooflight.pages.parallel import Workers


@contextmanager
def workers(cluster: str | None) -> Iterator[Workers | None]:
    """Connect to the workers that the user's ``--cluster`` names; None: it was not given.

    RequestError: they do not answer or are of another version, or Dask is not installed.
    """
    if cluster is None:
        yield None
        return
    try:
        from prooflight.cluster.connection import connected
    except ModuleNotFoundError as error:
        if error.name and error.name.startswith("prooflight"):
            raise
        remedy = 'pip install "prooflight[cluster]"'
        raise RequestError("--cluster", f"{error.name} is not installed", remedy=remedy) from error
    with connected(cluster) as connection:
        yield connection
