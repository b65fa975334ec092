"""Commands of many options: the options are fields of frozen dataclasses, which may hold further such groups."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from inspect import Parameter, Signature
from typing import Any, TypeVar, get_type_hints

import typer

Options = TypeVar("Options")


def with_options(
    command: Callable[[Options, typer.Context], None], options: type[Options]
) -> Callable[..., None]:
    """Return ``command`` as a function whose parameters are the fields of ``options``, for Typer.

    ``--help`` lists the options in the order of the fields, those of a group at the place of the group. The fields are
    annotated as parameters of a Typer command are.
    """

    def called(context: typer.Context, **given: Any) -> None:
        command(_built(options, given), context)

    parameters = [
        Parameter("context", Parameter.KEYWORD_ONLY, annotation=typer.Context),
        *_parameters(options),
    ]
    called.__signature__ = Signature(parameters)  # type: ignore[attr-defined]  # inspect.signature reads it
    called.__annotations__ = {one.name: one.annotation for one in parameters}
    called.__name__, called.__doc__ = command.__name__, command.__doc__
    return called


def _parameters(options: type) -> Iterator[Parameter]:
    hints = get_type_hints(options, include_extras=True)
    for one in fields(options):
        if is_dataclass(hints[one.name]):
            yield from _parameters(hints[one.name])
        else:
            default = Parameter.empty if one.default is MISSING else one.default
            yield Parameter(one.name, Parameter.KEYWORD_ONLY, default=default, annotation=hints[one.name])


def _built(options: type[Options], given: Mapping[str, Any]) -> Options:
    hints = get_type_hints(options)
    return options(
        **{
            name: _built(hint, given) if is_dataclass(hint) else given[name]  # type: ignore[arg-type]
            for name, hint in hints.items()
        }
    )
