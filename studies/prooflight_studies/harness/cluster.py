"""Distribution of work to a Dask cluster, for studies that outgrow one machine."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, TypeVar

from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

Item = TypeVar("Item")
Result = TypeVar("Result")

CONNECT_S: Final = 5
RETRIES: Final = 3
"""Number of times that a piece is restarted after its worker was lost; Dask does so by itself twice more."""


def on_cluster(
    work: Callable[[Item], Result], items: Sequence[Item], *, address: str
) -> Iterator[tuple[int, Result]]:
    """Apply ``work`` to each item on the cluster at ``address`` (tcp://...) and yield (index, result).

    Results come in the order in which they finish. ``work`` and items must be picklable, and the workers need this
    package in the same version; they need not share files. ``work`` is sent once to each worker, since it may hold a
    press. When a worker is lost, other workers restart its pieces.

    Raises
    ------
    RequestError
        No cluster answers, or every worker was lost.
    """
    from distributed import Client, as_completed
    from distributed.scheduler import KilledWorker

    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        remedy = "start `dask scheduler` and `dask worker`, and give the scheduler's address, tcp://host:port"
        raise RequestError(address, "no Dask cluster answers", remedy=remedy) from error
    with client:
        shared = client.scatter(work, broadcast=True, hash=False)
        futures = [client.submit(_apply, shared, item, pure=False, retries=RETRIES) for item in items]
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
