"""Set up, zones: what lies beside a job is listed with its price, drawn, and wrong files are told."""

from __future__ import annotations

import errno
import io
import json
import multiprocessing
import os
from contextlib import closing
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from packages.console.tests.consoles import served
from packages.console.tests.zone_prices import (
    counting_threads,
    endless,
    priced_by,
    quick,
    real,
    refused,
    vanishing,
)
from PIL import Image

from prooflight.pages.files import write_tiff
from prooflight.pages.raster import Page
from prooflight.pages.zones.zones_file import JobZones, PriceEntry, ZoneEntry
from prooflight_console.accounts.roles import Role, Scope

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from packages.console.tests.consoles import Served
    from starlette.testclient import TestClient

    from prooflight.press.artefact import Press


def job_of(folder: Path) -> Path:
    cmyk = np.zeros((400, 300, 4), np.uint8)
    cmyk[50:100, 50:200, 0] = 200
    path = folder / "letter.tif"
    write_tiff(Page(cmyk=cmyk, dpi=100, name="p0001", number=1), path)
    return path


def zones(name: str = "face") -> JobZones:
    entries = [
        ZoneEntry(name=name, kind="careful", rectangle_mm=(10, 10, 30, 30)),
        ZoneEntry(name="stamp", kind="ignore", rectangle_mm=(35, 35, 20, 20)),
    ]
    return JobZones.create(entries, [(76.2, 101.6)])


def test_zones_beside_a_job_are_listed_with_their_price_and_drawn(tmp_path: Path) -> None:
    job, made = job_of(tmp_path), zones("<b>face</b>")
    caught = {"spot": {"least": 0.8, "low": 0.5, "high": 1.2}}
    none = {"spot": {"least": None, "low": None, "high": None}}
    price = PriceEntry(
        press="x", zones=made.zones_digest, prints=90, seed=1, page_scores=(0.0, 1.0),
        careful_scores=(0.0, 1.0), careful_mean=(0.0,), careful_sd=(1.0,),
        told=({"name": "stamp", "kind": "ignore", "pages": [1], "before": caught, "after": none},),
    )  # fmt: skip
    made.priced(price).save(tmp_path / "letter.zones.json")
    with closing(served(tmp_path, jobs=(job,))) as console:
        viewer = console.client(Role.VIEWER)
        text = viewer.get("/setup/zones").text
        assert "&lt;b&gt;face&lt;/b&gt;" in text
        assert "<b>face" not in text
        assert "price calculated from 90 good prints" in text
        assert "0.8 mm" in text
        assert "not detected" in text
        assert "careful applies" in text  # where the two overlap
        drawn = viewer.get("/setup/zones/1/picture")
        assert drawn.content.startswith(b"\x89PNG")
        assert viewer.get("/setup/zones/2/picture").status_code == 404
        assert console.client().get("/setup/zones/1/picture", follow_redirects=False).status_code in (
            303,
            401,
        )


def test_unpriced_changed_and_broken_zones_are_told(tmp_path: Path) -> None:
    job = job_of(tmp_path)
    with closing(served(tmp_path, jobs=(job,))) as console:
        viewer = console.client(Role.VIEWER)
        assert "No zones are defined for this job" in viewer.get("/setup/zones").text
        zones().save(tmp_path / "letter.zones.json")
        assert "not active" in viewer.get("/setup/zones").text
        (tmp_path / "letter.zones.json").write_text('{"zones": [')
        assert "is not JSON" in viewer.get("/setup/zones").text
        assert viewer.get("/setup/zones/1/picture").status_code == 404


# --- drawn, priced and saved ---


@pytest.fixture
def desk(tmp_path: Path, trained_press: Press) -> Callable[..., Served]:
    """Makes consoles with a job of a page and a press, whose prices are made as is said."""
    job, artefact = job_of(tmp_path), tmp_path / "my.press"
    trained_press.save(artefact)

    def make(work: Any = quick) -> Served:
        return priced_by(tmp_path, work, jobs=(job,), presses=(artefact,))

    return make


FACE = {"name": "face", "kind": "careful", "pages": "all", "rectangle_mm": [10.0, 10.0, 30.0, 30.0]}
AT = "/api/v1/jobs/1/zones"


def ended(client: TestClient, price: dict[str, Any]) -> dict[str, Any]:
    """The price once it is no longer being made: each answer waits until it is further."""
    while price["state"] == "running":
        seen = f"{price['stage']}:{price['done']}"
        price = client.get(f"/api/v1/zones/prices/{price['id']}", params={"seen": seen}).json()
    return price


def test_zones_are_saved_with_a_price_of_exactly_these_alone(
    desk: Callable[..., Served], tmp_path: Path
) -> None:
    file = tmp_path / "letter.zones.json"
    with closing(desk()) as console:
        engineer = console.client(Role.ENGINEER)
        first = engineer.get(AT)
        assert (first.json()["zones"], first.json()["in_force"]) == ([], False)
        tag = {"If-Match": first.headers["ETag"]}
        assert engineer.put(AT, json={"zones": [FACE]}).status_code == 428
        unpriced = engineer.put(AT, json={"zones": [FACE]}, headers=tag)
        assert (unpriced.status_code, unpriced.json()["type"]) == (409, "urn:prooflight:unpriced")
        assert not file.exists()

        asked = engineer.post(f"{AT}/prices", json={"zones": [FACE]})
        assert asked.status_code == 202
        price = ended(engineer, asked.json())
        assert (price["state"], price["price"]["promised"]) == ("done", 0.01)
        assert [one["kind"] for one in price["price"]["zones"]] == ["careful", "rest"]
        assert engineer.post(f"{AT}/prices", json={"zones": [FACE]}).json()["id"] == price["id"], (
            "known already"
        )

        moved = {**FACE, "rectangle_mm": [10.1, 10.0, 30.0, 30.0]}
        assert engineer.put(AT, json={"zones": [moved]}, headers=tag).status_code == 409
        more = {"zones": [FACE], "careful_share": 0.3}
        assert engineer.put(AT, json=more, headers=tag).status_code == 409
        saved = engineer.put(AT, json={"zones": [FACE]}, headers=tag)
        assert saved.status_code == 200, saved.text
        assert (saved.json()["in_force"], saved.json()["prints"]) == (True, 90)
        known = JobZones.read(file, [(76.2, 101.6)])
        assert known.digest == saved.json()["digest"]

        # Whoever read before that has lost nothing, and overwrites nothing.
        late = engineer.put(AT, json={"zones": [FACE]}, headers=tag)
        assert (late.status_code, late.json()["type"]) == (412, "urn:prooflight:changed")
        assert engineer.delete(AT, headers=tag).status_code == 412
        gone = engineer.delete(AT, headers={"If-Match": saved.headers["ETag"]})
        assert gone.status_code == 204
        assert not file.exists()
        told = [(one.who, one.what, one.before, one.after) for one in console.accounts.audited(limit=2)]
        assert [(who, what) for who, what, _, _ in told] == [
            ("engineer", "zones.remove"),
            ("engineer", "zones.save"),
        ]
        assert json.loads(told[1][3] or "")["zones"] == ["face: careful, all, 10 10 30 30 mm"]
        assert json.loads(told[0][2] or "") == json.loads(told[1][3] or "")
        assert json.loads(told[0][3] or "")["zones"] == []
        assert console.accounts.verified().whole


def test_a_job_that_has_changed_since_its_price_is_not_saved(
    desk: Callable[..., Served], tmp_path: Path
) -> None:
    with closing(desk()) as console:
        engineer = console.client(Role.ENGINEER)
        price = ended(engineer, engineer.post(f"{AT}/prices", json={"zones": [FACE]}).json())
        assert price["state"] == "done"
        cmyk = np.full((400, 300, 4), 7, np.uint8)
        write_tiff(Page(cmyk=cmyk, dpi=100, name="p0001", number=1), tmp_path / "letter.tif")
        tag = {"If-Match": engineer.get(AT).headers["ETag"]}
        refused_now = engineer.put(AT, json={"zones": [FACE]}, headers=tag)
        assert refused_now.json()["type"] == "urn:prooflight:unpriced"


def test_a_file_that_cannot_be_written_is_told_and_audited(
    desk: Callable[..., Served], monkeypatch: pytest.MonkeyPatch
) -> None:
    with closing(desk()) as console:
        engineer = console.client(Role.ENGINEER)
        ended(engineer, engineer.post(f"{AT}/prices", json={"zones": [FACE]}).json())

        def full(_self: JobZones, _path: Path) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(JobZones, "save", full)
        tag = {"If-Match": engineer.get(AT).headers["ETag"]}
        answer = engineer.put(AT, json={"zones": [FACE]}, headers=tag)
        assert (answer.status_code, "No space left" in answer.text) == (503, True)
        assert console.accounts.audited(limit=1)[0].what == "zones.unsaved"


def test_only_engineers_and_tokens_of_that_scope_price_and_save(desk: Callable[..., Served]) -> None:
    with closing(desk()) as console:
        operator, nobody = console.client(Role.OPERATOR), console.client()
        console.client(Role.ENGINEER)
        body = {"zones": [FACE]}
        assert operator.get(AT).status_code == 200
        assert nobody.get(AT).status_code == 401
        for client, code in ((operator, 403), (nobody, 401)):
            assert client.post(f"{AT}/prices", json=body).status_code == code
            assert client.put(AT, json=body, headers={"If-Match": "x"}).status_code == code
            assert client.delete(AT, headers={"If-Match": "x"}).status_code == code
            assert client.delete("/api/v1/zones/prices/abc").status_code == code
        assert operator.get("/setup/zones/1").status_code == 403
        assert "/setup/zones/1" not in operator.get("/setup/zones").text.replace("/setup/zones/1/picture", "")
        for scope, code in ((Scope.READ, 403), (Scope.ZONES, 202)):
            secret = console.accounts.new_token("engineer", scope.value, [scope], by="test")[1]
            program = {"Authorization": f"Bearer {secret}"}
            assert nobody.post(f"{AT}/prices", json=body, headers=program).status_code == code


@pytest.mark.parametrize(
    ("zone", "said"),
    [
        ({**FACE, "rectangle_mm": [60.0, 10.0, 30.0, 30.0]}, "13.8 mm beyond page 1"),
        ({**FACE, "rectangle_mm": [1.0, 1.0, 0.5, 0.5]}, "0.25 mm2"),
        ({**FACE, "rectangle_mm": [1.0, 1.0, 0.0, 5.0]}, "more than 0"),
        ({**FACE, "rectangle_mm": None}, "rectangle_mm or polygon_mm"),
        ({**FACE, "pages": "2"}, "there is no page 2"),
        ({**FACE, "kind": "ignore", "rectangle_mm": [0.0, 0.0, 76.0, 101.0]}, "ignore 100% of page 1"),
        ({**FACE, "kind": "harsh"}, "kind"),
    ],
)
def test_zones_that_cannot_be_are_refused_in_words(
    desk: Callable[..., Served], zone: dict[str, Any], said: str
) -> None:
    with closing(desk()) as console:
        answer = console.client(Role.ENGINEER).post(f"{AT}/prices", json={"zones": [zone]})
        assert answer.status_code == 422
        assert said in answer.text


def test_a_price_is_cancelled_and_one_is_made_at_a_time(desk: Callable[..., Served]) -> None:
    with closing(desk(endless)) as console:
        engineer = console.client(Role.ENGINEER)
        price = engineer.post(f"{AT}/prices", json={"zones": [FACE]}).json()
        further = price
        # A busy machine takes longer to start it than an answer waits.
        while further["state"] == "running" and further["done"] == 0:
            seen = {"seen": f"{further['stage']}:{further['done']}"}
            further = engineer.get(f"/api/v1/zones/prices/{price['id']}", params=seen).json()
        assert (further["state"], further["done"], further["total"]) == ("running", 3, 90)
        other = {"zones": [{**FACE, "name": "logo"}]}
        busy = engineer.post(f"{AT}/prices", json=other)
        assert (busy.status_code, busy.json()["type"]) == (409, "urn:prooflight:busy")
        assert engineer.delete(f"/api/v1/zones/prices/{price['id']}").json()["state"] == "cancelled"
        assert engineer.get(f"{AT}/prices").json()["items"][0]["state"] == "cancelled"
        assert engineer.post(f"{AT}/prices", json=other).status_code == 202
        assert engineer.get("/api/v1/zones/prices/nothing").status_code == 404


@pytest.mark.parametrize(
    ("work", "why"),
    [(refused, "12 are too few"), (vanishing, "ended before it was done"), (counting_threads, "1 at once")],
)
def test_why_there_is_no_price_is_told(desk: Callable[..., Served], work: Any, why: str) -> None:
    with closing(desk(work)) as console:
        engineer = console.client(Role.ENGINEER)
        price = ended(engineer, engineer.post(f"{AT}/prices", json={"zones": [FACE]}).json())
        assert price["state"] == "failed"
        assert why in price["why"]


def test_a_price_whose_process_cannot_start_is_told_and_the_next_is_made(
    desk: Callable[..., Served], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_self: object) -> None:
        raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))

    with closing(desk(quick)) as console:
        engineer = console.client(Role.ENGINEER)
        with monkeypatch.context() as patch:
            patch.setattr(multiprocessing.get_context("spawn").Process, "start", refuse)
            answer = engineer.post(f"{AT}/prices", json={"zones": [FACE]})
        assert (answer.status_code, answer.json()["type"]) == (503, "urn:prooflight:no-process")
        told = answer.json()["detail"]
        assert told.startswith("no process can be started for the price (Cannot allocate memory); close")
        assert "Errno" not in told
        price = ended(engineer, engineer.post(f"{AT}/prices", json={"zones": [FACE]}).json())
        assert price["state"] == "done"


def test_a_real_price_is_made_aside(
    tmp_path: Path, make_page: Callable[..., Page], trained_press: Press
) -> None:
    job, artefact = tmp_path / "page.tif", tmp_path / "my.press"
    write_tiff(make_page(3), job)
    trained_press.save(artefact)
    with closing(priced_by(tmp_path, real, jobs=(job,), presses=(artefact,))) as console:
        engineer = console.client(Role.ENGINEER)
        stamp = {"name": "stamp", "kind": "ignore", "rectangle_mm": [5.0, 5.0, 12.0, 12.0]}
        asked = engineer.post(f"{AT}/prices", json={"zones": [stamp], "prints": 12, "trials": 0})
        price = ended(engineer, asked.json())
        assert price["state"] == "done", price["why"]
        assert price["price"]["good_prints"] == 8
        tag = {"If-Match": engineer.get(AT).headers["ETag"]}
        assert engineer.put(AT, json={"zones": [stamp]}, headers=tag).status_code == 200
        known = JobZones.read(tmp_path / "page.zones.json", [(36.0, 44.0)])
        known.refuse_unpriced(trained_press.digest, "matched_filter", where="zones")  # in force on this press


def test_a_page_is_drawn_in_tiles_and_says_what_it_proposes(tmp_path: Path, trained_press: Press) -> None:
    from tests.cli.test_zones import write_pdf

    artefact = tmp_path / "my.press"
    trained_press.save(artefact)
    write_pdf(tmp_path / "job.pdf")
    with closing(served(tmp_path, jobs=(tmp_path / "job.pdf",))) as console:
        viewer = console.client(Role.VIEWER)
        base = "/api/v1/jobs/1/pages/1"
        assert viewer.get(f"{base}/picture/0/0/0").status_code == 404, "not drawn yet"
        told = viewer.get(f"{base}/picture").json()
        assert (told["width_mm"], told["height_mm"]) == pytest.approx(
            (210 * 25.4 / 72, 297 * 25.4 / 72), abs=0.2
        )
        tile = viewer.get(f"{base}/picture/{told['levels'] - 1}/0/0")
        assert tile.headers["content-type"] == "image/webp"
        again = viewer.get(
            f"{base}/picture/{told['levels'] - 1}/0/0", headers={"If-None-Match": tile.headers["ETag"]}
        )
        assert again.status_code == 304
        per_mm = told["width"] / told["width_mm"]
        with Image.open(io.BytesIO(tile.content)) as picture:
            x, y = (round(part * 25.4 / 72 * per_mm) for part in (85, 110))
            red, green, blue = picture.convert("RGB").getpixel((x, y))
        assert blue > green > red, "the layer's rectangle in its colour"
        found = viewer.get(f"{base}/proposals").json()["items"]
        assert {one["source"] for one in found} == {"box", "layer", "annotation"}
        assert {one["zone"]["name"]: one["zone"]["kind"] for one in found}["Faces"] == "careful"
        assert viewer.get("/api/v1/jobs/1/pages/2/picture").status_code == 404
        assert viewer.get("/api/v1/jobs/2/zones").status_code == 404
        assert viewer.get("/api/v1/jobs").json()["items"][0]["pages"] == 1
