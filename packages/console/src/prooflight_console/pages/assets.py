"""Scripts, styles and fonts, which all come from the console itself."""

from __future__ import annotations

from importlib.resources import files
from typing import Final

from fastapi import APIRouter, Depends, Request, Response

from prooflight_console.access import open_to_all
from prooflight_console.api.common import etag, not_modified, unchanged
from prooflight_console.problems import not_found

router = APIRouter(include_in_schema=False)

TYPES: Final = {
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".woff2": "font/woff2",
    ".webmanifest": "application/manifest+json",
    ".txt": "text/plain; charset=utf-8",
    ".LICENSE": "text/plain; charset=utf-8",
}
FOR_GOOD: Final = "public, max-age=31536000, immutable"
A_DAY: Final = "public, max-age=86400"


@router.get("/static/{name:path}", dependencies=[Depends(open_to_all())])
def static(request: Request, name: str) -> Response:
    """Return a static file."""
    parts = name.split("/")
    suffix = next((end for end in TYPES if name.endswith(end)), None)
    if suffix is None or len(parts) > 2 or any(part in ("", ".", "..") or "\\" in part for part in parts):
        raise not_found(f"there is no {name[:80]!r}")
    file = files("prooflight_console").joinpath("static", *parts)
    if not file.is_file():
        raise not_found(f"there is no {name[:80]!r}")
    content = file.read_bytes()
    tag = etag(content)
    cache = FOR_GOOD if request.query_params.get("v") else A_DAY
    if unchanged(request, tag):
        return not_modified(tag, cache)
    return Response(content, media_type=TYPES[suffix], headers={"ETag": tag, "Cache-Control": cache})
