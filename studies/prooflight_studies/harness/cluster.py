"""Work sent to a Dask cluster, for studies that outgrow one machine."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, TypeVar

from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

Item = TypeVar("Item")
Result = TypeVar("Result")

CONNECT_S: Final = 5
RETRIES: Final = 3
"""How often a piece is begun again on another worker, when its worker was lost; Dask does so by itself twice more."""


def on_cluster(
    work: Callable[[Item], Result], items: Sequence[Item], *, address: str
) -> Iterator[tuple[int, Result]]:
    """``work`` of each item on the cluster at ``address`` (tcp://...): (place among the items, result), as they finish.

    ``work`` and items must be picklable, and the workers need this package in the same version; files they need not
    share. ``work`` travels once to each worker, since it may hold a press. A worker that is lost costs the pieces it
    was at, which others begin again. RequestError: no cluster answers, or every worker was lost.
    """
    from distributed import Client, as_completed
    from distributed.scheduler import KilledWorker

    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        remedy = "start `dask scheduler` and `dask worker`, and give the scheduler's address, tcp://host:port"
        raise RequestError(address, "no Dask cluster answers", remedy=remedy) from error
    with client:
        held = client.scatter(work, broadcast=True, hash=False)
        futures = [client.submit(_apply, held, item, pure=False, retries=RETRIES) for item in items]
        places = {future.key: place for place, future in enumerate(futures)}
        try:
            for future in as_completed(futures, loop=client.loop):
                place = places[future.key]
                yield place, future.result()
                future.release()
        except KilledWorker as error:
            what = f"lost {error.last_worker.address} and others at one piece"
            raise RequestError(
                address, what, remedy="give workers more memory; what is done is kept"
            ) from error


def _apply(work: Callable[[Any], Any], item: Any) -> Any:
    return work(item)
