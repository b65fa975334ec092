"""schemathesis asks the API all that its schema allows: no fault, and no answer that the schema does not name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
import schemathesis
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from packages.console.tests.consoles import Served, served
from schemathesis.specs.openapi import checks as openapi_checks

from prooflight_console.accounts.roles import Role, Scope
from prooflight_console.api.audit import openapi

if TYPE_CHECKING:
    from collections.abc import Iterator

EXAMPLES = 6
"""Of every operation, in each of two ways; `--hypothesis-profile=explore` tries no more, raise this for that."""
METHODS = ("get", "post", "put", "patch", "delete")


@pytest.fixture(scope="module")
def console(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    made = served(tmp_path_factory.mktemp("console"))
    made.client(Role.ADMIN)
    yield made
    made.close()


@pytest.fixture(scope="module")
def schema(console: Served) -> Any:
    """Without events, which go on for ever."""
    found = schemathesis.openapi.from_asgi(
        "/api/v1/openapi.json", console.app, headers={"Authorization": f"Bearer {token(console)}"}
    )
    return found.exclude(path="/api/v1/events")


def token(console: Served) -> str:
    return console.accounts.new_token("admin", "schemathesis", list(Scope), by="test")[1]


def test_every_operation_answers_as_its_schema_says(console: Served, schema: Any) -> None:
    headers = {"Authorization": f"Bearer {token(console)}"}
    asked = 0

    for result in schema.get_all_operations():
        operation = result.ok()

        @given(case=operation.as_strategy(), run=st.sampled_from(["1", "last", None]))
        @settings(
            max_examples=EXAMPLES,
            deadline=None,
            derandomize=True,
            database=None,
            suppress_health_check=list(HealthCheck),
        )
        def ask(case: Any, run: str | None) -> None:
            nonlocal asked
            if run is not None and "run" in (case.path_parameters or {}):
                case.path_parameters["run"] = run  # of one that is there
            answer = case.call(headers=headers)
            assert answer.status_code < 500 or answer.status_code == 503, answer.text
            case.validate_response(answer, checks=CHECKS)
            asked += 1

        ask()
    assert asked > EXAMPLES * 10


CHECKS = (
    schemathesis.checks.not_a_server_error,
    openapi_checks.status_code_conformance,
    openapi_checks.content_type_conformance,
    openapi_checks.response_schema_conformance,
)


def test_every_operation_names_what_it_refuses_with(console: Served) -> None:
    for path, operations in openapi(console.app)["paths"].items():
        for method, operation in operations.items():
            if method not in METHODS:
                continue
            codes = set(operation["responses"])
            assert {"401", "403"} <= codes, (method, path)
            if operation.get("parameters") or operation.get("requestBody"):
                assert "422" in codes, (method, path)
            refused = operation["responses"]["401"]["content"]
            assert list(refused) == ["application/problem+json"]
