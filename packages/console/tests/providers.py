"""A small OpenID provider on loopback: discovery, keys, the code flow with PKCE, signing out; and its faults."""

from __future__ import annotations

import base64
import hashlib
import json
import secrets
import threading
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, unquote_plus, urlencode, urlsplit

from joserfc import jwt
from joserfc.jwk import RSAKey

if TYPE_CHECKING:
    from collections.abc import Callable

    from packages.console.tests.consoles import Clock

KEY = RSAKey.generate_key(2048, {"kid": "1"}, private=True)
"""Of all of them: making one takes a while."""
CLIENT, SECRET = "prooflight", "a secret that both know"


@dataclass
class SmallProvider:
    """One person is signed in there, and is who the tests say."""

    clock: Clock
    redirect_uri: str
    person: dict[str, Any] = field(default_factory=dict)
    """Claims of the ID token beside those that the protocol needs."""
    spoilt: dict[str, Any] = field(default_factory=dict)
    """Claims that stand in place of the right ones; None: left out."""
    described: dict[str, Any] = field(default_factory=dict)
    """Likewise of what it says of itself."""
    answer: Callable[[str], tuple[int, bytes] | None] = lambda _path: None
    """Another answer at a path."""
    key: RSAKey = field(default_factory=lambda: KEY)
    algorithm: str = "RS256"
    signs_with: Any = None
    """None: by ``key``."""
    asked: list[dict[str, str]] = field(default_factory=list)
    """What browsers brought."""
    codes: dict[str, dict[str, str]] = field(default_factory=dict)
    _server: ThreadingHTTPServer | None = None

    @property
    def issuer(self) -> str:
        assert self._server is not None
        return f"http://127.0.0.1:{self._server.server_address[1]}"

    def __enter__(self) -> SmallProvider:
        provider = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                provider.get(self)

            def do_POST(self) -> None:
                provider.post(self)

            def log_message(self, *_told: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.01})
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self.down()

    def down(self) -> None:
        """Nobody listens there any more."""
        if self._thread.is_alive():
            assert self._server is not None
            self._server.shutdown()
            self._thread.join()
            self._server.server_close()

    # --- endpoints ---

    def get(self, request: BaseHTTPRequestHandler) -> None:
        parts = urlsplit(request.path)
        if (other := self.answer(parts.path)) is not None:
            return _say(request, *other)
        if parts.path == "/.well-known/openid-configuration":
            return _json(request, self.description())
        if parts.path == "/keys":
            return _json(request, {"keys": [self.key.as_dict(private=False)]})
        if parts.path == "/authorize":
            return self.authorize(request, {k: v[0] for k, v in parse_qs(parts.query).items()})
        return _say(request, 404, b"")

    def post(self, request: BaseHTTPRequestHandler) -> None:
        body = request.rfile.read(int(request.headers["Content-Length"])).decode()
        path = urlsplit(request.path).path
        if (other := self.answer(path)) is not None:
            return _say(request, *other)
        return self.token(request, {k: v[0] for k, v in parse_qs(body).items()})

    def description(self) -> dict[str, Any]:
        told = {
            "issuer": self.issuer,
            "authorization_endpoint": f"{self.issuer}/authorize",
            "token_endpoint": f"{self.issuer}/token",
            "jwks_uri": f"{self.issuer}/keys",
            "end_session_endpoint": f"{self.issuer}/end",
            "response_types_supported": ["code"],
            "authorization_response_iss_parameter_supported": True,
        }
        return _without_none(told | self.described)

    def authorize(self, request: BaseHTTPRequestHandler, asked: dict[str, str]) -> None:
        """The person is signed in already, and says yes."""
        self.asked.append(asked)
        wanted = {"client_id": CLIENT, "redirect_uri": self.redirect_uri, "response_type": "code"}
        wanted["code_challenge_method"] = "S256"
        if any(asked.get(name) != value for name, value in wanted.items()) or "openid" not in asked["scope"]:
            return _say(request, 400, b"no such client")
        code = secrets.token_urlsafe(16)
        self.codes[code] = asked
        back = urlencode({"code": code, "state": asked["state"], "iss": self.issuer})
        return _say(request, 302, b"", {"Location": f"{self.redirect_uri}?{back}"})

    def token(self, request: BaseHTTPRequestHandler, asked: dict[str, str]) -> None:
        kind, _, basic = request.headers.get("Authorization", "").partition(" ")
        if kind != "Basic" or unquote_plus(base64.b64decode(basic).decode()) != f"{CLIENT}:{SECRET}":
            return _json(request, {"error": "invalid_client"}, 401)
        begun = self.codes.pop(asked.get("code", ""), None)  # it works once
        digest = hashlib.sha256(asked.get("code_verifier", "").encode()).digest()
        challenge = base64.urlsafe_b64encode(digest).rstrip(b"=").decode()
        if begun is None or begun["code_challenge"] != challenge:
            return _json(request, {"error": "invalid_grant", "error_description": "no such code"}, 400)
        now = int(self.clock.now_s)
        claims = {"iss": self.issuer, "aud": CLIENT, "sub": "u-1", "iat": now, "exp": now + 300}
        claims |= {"nonce": begun["nonce"]} | self.person
        header = {"alg": self.algorithm, "kid": self.key.kid}
        told = jwt.encode(
            header, _without_none(claims | self.spoilt), self.signs_with or self.key, [self.algorithm]
        )
        return _json(request, {"access_token": "a", "token_type": "Bearer", "id_token": told})


def _without_none(told: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in told.items() if value is not None}


def _json(request: BaseHTTPRequestHandler, told: dict[str, Any], status: int = 200) -> None:
    _say(request, status, json.dumps(told).encode(), {"Content-Type": "application/json"})


def _say(
    request: BaseHTTPRequestHandler, status: int, body: bytes, headers: dict[str, str] | None = None
) -> None:
    request.send_response(status)
    for name, value in ({"Content-Length": str(len(body))} | (headers or {})).items():
        request.send_header(name, value)
    request.end_headers()
    request.wfile.write(body)
