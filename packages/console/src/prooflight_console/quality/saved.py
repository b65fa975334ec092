"""Searches that people saved under a name, in the console's own file; each sees their own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sqlalchemy import Column, Integer, MetaData, String, Table, UniqueConstraint, delete, insert, select

from prooflight.errors import RequestError
from prooflight_console.accounts.database import writing

if TYPE_CHECKING:
    from prooflight_console.accounts.account_store import Accounts

MOST_NAME: Final = 80
MOST_SEARCHES: Final = 50
# Added to a file of any schema: a version that does not know the table leaves it alone.
_tables = MetaData()
_searches = Table(
    "searches",
    _tables,
    Column("id", Integer, primary_key=True),
    Column("person", String, nullable=False),
    Column("name", String, nullable=False),
    Column("query", String, nullable=False),
    UniqueConstraint("person", "name"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SavedSearch:
    """A saved search."""

    id: int
    name: str
    query: str
    """Query of its address, without the question mark."""


class SavedSearches:
    """Saved searches of all users."""

    def __init__(self, accounts: Accounts) -> None:
        self._engine = accounts.engine
        _tables.create_all(writing(self._engine))

    def of(self, person: str) -> list[SavedSearch]:
        """Return the searches of a person, by name."""
        column = _searches.c
        query = select(column.id, column.name, column.query).where(column.person == person)
        with self._engine.begin() as connection:
            rows = connection.execute(query.order_by(column.name)).all()
        return [SavedSearch(id=row.id, name=row.name, query=row.query) for row in rows]

    def save(self, person: str, name: str, query: str) -> None:
        """Save a search; one of the same name is replaced. RequestError: it has no name, or there are too many."""
        name = " ".join(name.split())
        if not 0 < len(name) <= MOST_NAME or not name.isprintable():
            raise RequestError("name", "is not a name", remedy=f"give 1 to {MOST_NAME} letters")
        column = _searches.c
        with writing(self._engine).begin() as connection:
            connection.execute(delete(_searches).where(column.person == person, column.name == name))
            saved = connection.execute(select(column.id).where(column.person == person)).all()
            if len(saved) >= MOST_SEARCHES:
                raise RequestError("name", f"there are {MOST_SEARCHES} searches", remedy="remove one first")
            connection.execute(insert(_searches).values(person=person, name=name, query=query))

    def remove(self, person: str, number: int) -> None:
        """Remove a search of a person; one that is not there is no fault."""
        column = _searches.c
        with writing(self._engine).begin() as connection:
            connection.execute(delete(_searches).where(column.person == person, column.id == number))
