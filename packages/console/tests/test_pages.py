"""Pages: names show as text, both languages say everything, and nothing comes from elsewhere."""

from __future__ import annotations

import hashlib
import io
import json
import re
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from packages.console.tests.consoles import PASSWORD, Served, served, write_run
from packages.line.tests.journal.sample_rows import misprint

from prooflight.detectors.disposition import LEAST_FIRST
from prooflight.simulation.misprints.kinds import KINDS
from prooflight_console.accounts.account_store import LANGUAGES
from prooflight_console.accounts.roles import Role
from prooflight_console.middleware import POLICY
from prooflight_console.pages.language import language
from prooflight_console.pages.shell import environment
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import LABELS
from prooflight_line.run.incidents import CAMERA_GONE, LATE, LOST_LINES, MISSING, NOT_INSPECTED, UNKNOWN
from prooflight_line.run_package.report import write_report

if TYPE_CHECKING:
    from starlette.testclient import TestClient

SERVER = Path(str(files("prooflight_console")))
SCRIPT = "<script>alert(1)</script>\"'<img src=x onerror=alert(1)>"
STATES = (
    "no-run",
    "waiting",
    "good",
    "overload",
    "stop",
    "blind",
    "look",
    "silent",
    "ended",
    "fault",
    "interrupted",
)


def pages_of(client: TestClient) -> dict[str, str]:
    addresses = ("/", "/runs/1/incidents/1", "/runs/1/sheets/10", "/runs/1/sheets/3", "/runs/1/reprint")
    found = {}
    for address in addresses:
        answer = client.get(address)
        assert answer.status_code == 200, address
        found[address] = answer.text
    return found


def test_stored_script_shows_as_text(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    write_run(console.journal, job=SCRIPT, press=SCRIPT, source=SCRIPT)
    name = "<b onclick=alert(1)>Ann"
    console.accounts.choose(console.accounts.add(name, Role.ADMIN, by="test"), PASSWORD)
    client = console.client()
    csrf = client.post("/api/v1/session", json={"name": name, "password": PASSWORD}).json()["csrf"]
    client.headers["X-CSRF-Token"] = csrf
    client.post("/api/v1/runs/1/incidents/1/labels", json={"label": "unknown", "note": SCRIPT})
    for address, text in pages_of(client).items():
        for raw in ("<script>alert", "<img src=x", "<b onclick"):
            assert raw not in text, address
        assert "&lt;script&gt;alert(1)" in text, address
        assert "&lt;b onclick" in text
    told = client.get("/runs/1/incidents/9/%3Cscript%3E")
    assert "<script>" not in re.sub(r"<script (src|type)[^>]*>", "", told.text)
    console.close()


def test_a_formula_in_a_name_reaches_no_spreadsheet_as_one(tmp_path: Path) -> None:
    console = served(tmp_path)
    text = console.client(Role.VIEWER).get("/runs/1/reprint.csv").text
    assert text.splitlines()[:2] == [
        "sheet,page,job_page,verdict,kind,incident,copy,number,pages,set,behind,why,take_out",
        "10,p0011,10,misprint,spots-voids,1,1,11,11,11,p0010,spots-voids,False",
    ]
    console.close()


def test_no_page_holds_script_or_style_that_the_policy_forbids(console: Served) -> None:
    for address, text in pages_of(console.client(Role.OPERATOR)).items():
        for tag in re.findall(r"<script\b[^>]*>", text):
            assert "src=" in tag or 'type="application/json"' in tag, (address, tag)
        assert not re.search(r"<[^>]+\s(on\w+|style)=", text), address
        assert not re.search(r"""(?:src|href)=["'](?:https?:)?//""", text), f"{address} loads from elsewhere"


def test_every_answer_carries_the_policy(console: Served) -> None:
    client = console.client(Role.VIEWER)
    for address in ("/", "/sign-in", "/api/v1/runs", "/static/console.css", "/nothing"):
        headers = client.get(address).headers
        assert headers["content-security-policy"] == POLICY
        assert headers["x-content-type-options"] == "nosniff"
    assert "unsafe" not in POLICY
    assert client.get("/").headers["cache-control"] == "no-store"


def test_both_languages_have_the_same_keys_and_places_for_values() -> None:
    english, german = (language(code) for code in LANGUAGES)
    assert english.keys() == german.keys()

    def places(text: str) -> set[str]:
        return set(re.findall(r"\{(\w+)\}", text))

    for key in sorted(english.keys()):
        assert places(english._words[key]) == places(german._words[key]), key


def test_every_key_that_a_template_names_is_there_and_every_word_is_used() -> None:
    sources = [path.read_text() for path in sorted(SERVER.rglob("*.j2")) + sorted(SERVER.rglob("*.py"))]
    text = "\n".join(sources)
    named = set(re.findall(r"""\bt\(\s*["']([\w.-]+)["']\s*[,)]""", text))
    missing = named - language("en").keys()
    assert not missing
    counted = set(re.findall(r"""\bt\.count\(\s*["']([\w.-]+)["']""", text))
    for key in counted:
        assert {f"{key}.one", f"{key}.many"} <= language("en").keys()


@pytest.mark.parametrize("code", LANGUAGES)
def test_everything_that_has_a_name_has_words(code: str) -> None:
    t = language(code)
    keys = [
        f"kind.{kind}" for kind in (*KINDS, MISSING, LOST_LINES, CAMERA_GONE, NOT_INSPECTED, LATE, UNKNOWN)
    ]
    keys += [f"state.{state}" for state in STATES] + [f"state.{state}.why" for state in STATES]
    keys += [f"word.{word}" for word in LABELS] + [f"role.{role}" for role in Role]
    keys += [f"disposition.{one}" for one in (*LEAST_FIRST, "costs")]
    keys += [f"verdict.{verdict}" for verdict in ("good", "misprint", "not-inspected")]
    assert set(keys) <= t.keys()


def test_the_language_is_the_person_s_else_the_browser_s(console: Served) -> None:
    client = console.client(Role.OPERATOR)
    german = {"Accept-Language": "de-AT,de;q=0.9,en;q=0.5"}
    assert '<html lang="de">' in client.get("/", headers=german).text
    assert '<html lang="en">' in client.get("/", headers={"Accept-Language": "fr"}).text
    assert client.post("/language/de").status_code == 204
    assert '<html lang="de">' in client.get("/", headers={"Accept-Language": "en"}).text
    assert client.post("/language/xx").status_code == 409


def test_every_template_compiles() -> None:
    names = environment().list_templates(extensions=["j2"])
    assert "now.html.j2" in names
    for name in names:
        environment().get_template(name)


def test_vendored_files_are_those_of_the_manifest() -> None:
    folder = SERVER / "static" / "vendor"
    manifest = json.loads((folder / "manifest.json").read_text())
    licences = {each["licence_file"] for each in manifest.values()}
    assert {path.name for path in folder.iterdir()} == {"manifest.json", *manifest, *licences}
    for name, each in manifest.items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == each["sha256"], name


@pytest.mark.parametrize("name", ["../app.py", "vendor/../../app.py", "..%2fapp.py", "app.py", "", "vendor/"])
def test_static_gives_nothing_else(console: Served, name: str) -> None:
    answer = console.client().get(f"/static/{name}")
    assert answer.status_code == 404
    assert "import" not in answer.text


def test_static_files_are_kept_by_browsers_until_they_change(console: Served) -> None:
    client = console.client()
    page = client.get("/sign-in").text
    address = re.search(r'href="(/static/console\.css\?v=\w+)"', page)
    assert address is not None
    answer = client.get(address[1])
    assert "immutable" in answer.headers["cache-control"]
    tag = {"If-None-Match": answer.headers["etag"]}
    assert client.get("/static/console.css", headers=tag).status_code == 304


def test_who_is_not_signed_in_comes_back_to_the_page_that_was_asked_for(console: Served) -> None:
    console.client(Role.VIEWER)
    client = console.client()
    form = client.get("/runs/1/incidents/1?sheet=11")
    assert form.status_code == 200
    assert 'name="next" value="/runs/1/incidents/1?sheet=11"' in form.text
    given = {"name": "viewer", "password": PASSWORD, "next": "/runs/1/incidents/1?sheet=11"}
    shown = client.post("/sign-in", data=given)
    assert "Spots or voids" in shown.text
    wrong = client.post("/sign-in", data=given | {"password": "wrong"})
    assert (wrong.status_code, "Name or password is wrong" in wrong.text) == (401, True)


def test_one_tap_is_kept_with_who_and_when(console: Served) -> None:
    operator = console.client(Role.OPERATOR)
    page = operator.get("/runs/1/incidents/1").text
    assert 'hx-post="/runs/1/incidents/1/label"' in page
    answer = operator.post("/runs/1/incidents/1/label", data={"label": "false-alarm", "note": "a hair"})
    assert answer.status_code == 200
    assert 'class="tap false-alarm" aria-pressed="true"' in answer.text
    assert "a hair" in answer.text
    assert "operator" in answer.text
    assert (
        'hx-post="/runs/1/incidents/1/label"'
        not in console.client(Role.VIEWER).get("/runs/1/incidents/1").text
    )


def test_seen_ends_the_alarm_and_not_the_incident(console: Served) -> None:
    operator = console.client(Role.OPERATOR)
    with Journal.open(str(console.journal)) as journal:
        for sheet in (30, 31, 32):
            journal.record(1, misprint(sheet))
        journal.commit()
        told = operator.get("/api/v1/now").json()
        assert (told["state"], told["alarm"]) == ("stop", True)
        assert operator.post("/runs/1/incidents/1/seen").status_code == 204
        console.console.live._poll()
        told = operator.get("/api/v1/now").json()
        assert (told["state"], told["alarm"], len(told["incidents"])) == ("stop", False, 1), "it goes on"


def test_the_report_as_pdf_is_the_one_that_packages_hold(console: Served) -> None:
    client = console.client(Role.VIEWER)
    assert 'href="/runs/1/report.pdf"' in client.get("/report/1").text
    with Journal.open(str(console.journal), read_only=True) as journal:
        expected = {}
        for code in ("en", "de"):
            file = io.BytesIO()
            write_report(file, journal, journal.run(1), language=code)
            expected[code] = file.getvalue()
    for code, content in expected.items():
        answer = client.get("/runs/1/report.pdf", headers={"Accept-Language": code})
        assert (answer.status_code, answer.headers["content-type"]) == (200, "application/pdf")
        assert answer.headers["content-disposition"] == 'attachment; filename="run-1.pdf"'
        assert answer.content == content
    assert client.get("/runs/9/report.pdf").status_code == 404
    assert console.client(None).get("/runs/1/report.pdf", follow_redirects=False).status_code == 303


def test_warnings_of_the_job_stand_on_the_page_now_and_in_the_report(tmp_path: Path) -> None:
    """Before the first sheet, and as text whatever they hold."""
    console = served(tmp_path, run=False)
    warnings = [
        {"page": number, "kind": "font-substituted", "message": f"font {number} {SCRIPT}", "object": ""}
        for number in (1, 2, 3, 4)
    ]
    unsound: list[object] = [7, {"page": "x", "message": 3}, {"page": [1], "message": "of no page"}]
    write_run(console.journal, sheets=0, settings={"warnings": [*warnings, *unsound]})
    client = console.client(Role.VIEWER)
    now, report = client.get("/").text, client.get("/report/1").text
    for text in (now, report):
        assert "5 job warnings" in text
        assert "p0001: font 1 &lt;script&gt;" in text
        assert "<script>alert" not in text
    assert "p0004" not in now
    assert "p0004: font 4" in report
    assert "of no page" in report
    console.close()


def test_a_run_without_warnings_says_nothing_of_them(console: Served) -> None:
    client = console.client(Role.VIEWER)
    assert "job warnings" not in client.get("/").text + client.get("/report/1").text
