"""Signing in at an OpenID provider: the code flow with PKCE, state and nonce (OpenID Connect Core 1.0, RFC 7636).

A sign-in that was begun is kept here for ten minutes and used once: its state is in a cookie of the browser that began
it, its nonce in the ID token, its code verifier nowhere else. The ID token is checked by the keys that the provider
publishes: signature, issuer, audience, time, nonce. The library knows how to ask and to verify; what is accepted is
said here.
"""

from __future__ import annotations

import secrets
import ssl
import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import quote_plus, urlencode, urlsplit

import anyio

from prooflight.errors import ProoflightError, RequestError, visible
from prooflight.press.outlets import is_loopback

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from joserfc.jwk import KeySet

    from prooflight.server.accounts.provider_file import ProviderSettings
    from prooflight.server.accounts.roles import Role

BEGUN_S: Final = 600.0
"""From the button to the return: to find a password and a second factor."""
MOST_BEGUN: Final = 10_000
"""Sign-ins under way; the oldest goes first."""
KNOWN_S: Final = 3600.0
"""The provider's own description and keys are asked for anew after so long."""
KEYS_AGAIN_S: Final = 30.0
"""A token of an unknown key makes the keys be asked for anew, but not more often."""
DOWN_S: Final = 5.0
"""A provider that did not answer is not asked again for so long: its failure must not hold all threads."""
ANSWERS_S: Final = 10.0
LEEWAY_S: Final = 60.0
"""Between two clocks."""
OLDEST_S: Final = 600.0
"""Of an ID token's issue, beside the leeway: it came from the provider a moment ago."""
AT_ONCE: Final = 4
ALGORITHMS: Final = ("RS256", "RS384", "RS512", "PS256", "PS384", "PS512", "ES256", "ES384", "ES512", "EdDSA")
"""Of signatures by a key that only the provider has; never `none` or HMAC."""
MOST_GROUPS: Final = 1000
JSON: Final = {"Accept": "application/json"}


class ProviderError(ProoflightError):
    """Nobody is signed in; kind: `down` (it does not answer), `begun` (begin again), `refused`."""

    def __init__(self, kind: str, detail: str) -> None:
        self.kind, self.detail = kind, visible(detail)[:400]
        super().__init__(self.detail)


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """Somebody that the provider vouches for."""

    issuer: str
    subject: str
    """Stays, whatever their name is."""
    name: str
    groups: tuple[str, ...]
    role: Role | None
    """None: no group of theirs is mapped."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Begun:
    nonce: str
    verifier: str
    next: str
    at_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Known:
    """What the provider says of itself (OpenID Connect Discovery 1.0)."""

    authorization: str
    token: str
    end_session: str | None
    auth_method: str
    names_itself: bool
    """Whether it says who it is when it sends a browser back (RFC 9207)."""
    keys: KeySet
    at_s: float


class Provider:
    """One provider; its methods wait for the network and are called in threads."""

    def __init__(self, settings: ProviderSettings, *, clock: Callable[[], float]) -> None:
        """RequestError: the extra is not installed, or the certificates cannot be used. clock: Unix time. [s]"""
        try:
            import authlib  # type: ignore[import-untyped]
            import httpx
            import joserfc
        except ImportError as error:
            remedy = 'install it with pip install "prooflight[oidc]"'
            raise RequestError("--oidc", f"{error.name} is not installed", remedy=remedy) from error
        del authlib, httpx, joserfc
        self.settings, self._clock = settings, clock
        self._trust = _trust(settings)
        self._begun: OrderedDict[str, _Begun] = OrderedDict()
        self._known: _Known | None = None
        self._down: tuple[float, str] | None = None
        self._guard, self._asking = threading.Lock(), threading.Lock()
        self.limiter = anyio.CapacityLimiter(AT_ONCE)
        """Of threads that wait for the provider: pages need theirs, whatever it does."""

    # --- the flow ---

    def begin(self, *, next: str) -> tuple[str, str]:
        """Where the browser is sent to, and the state for its cookie. next: the page wanted. ProviderError."""
        from authlib.oauth2.rfc6749.parameters import prepare_grant_uri  # type: ignore[import-untyped]
        from authlib.oauth2.rfc7636 import create_s256_code_challenge  # type: ignore[import-untyped]

        known = self._described()
        state = secrets.token_urlsafe(32)
        begun = _Begun(
            nonce=secrets.token_urlsafe(32), verifier=secrets.token_urlsafe(48), next=next, at_s=self._clock()
        )
        with self._guard:
            self._begun[state] = begun
            while len(self._begun) > MOST_BEGUN:
                self._begun.popitem(last=False)
        more = {"nonce": begun.nonce} | ({"prompt": "login"} if self.settings.ask_again else {})
        address = prepare_grant_uri(
            known.authorization,
            self.settings.client_id,
            "code",
            redirect_uri=self.settings.return_address,
            scope=" ".join(self.settings.scopes),
            state=state,
            code_challenge=create_s256_code_challenge(begun.verifier),
            code_challenge_method="S256",
            **more,
        )
        return address, state

    def finish(self, told: Mapping[str, str], *, state: str) -> tuple[Identity, str]:
        """Who came back, and which page they wanted. told: what the provider sent. state: of the browser's cookie.

        ProviderError.
        """
        begun = self._take(told.get("state", ""), state)
        if "error" in told:
            what = f"{told['error']} {told.get('error_description', '')}".strip()
            raise ProviderError("refused", f"it said: {what}")
        known = self._described()
        issuer = told.get("iss")
        if issuer != self.settings.issuer and (issuer is not None or known.names_itself):
            raise ProviderError("refused", "another provider sent the browser back")
        if not told.get("code"):
            raise ProviderError("refused", "it sent no code")
        token = self._exchanged(known, told["code"], begun.verifier)
        return self._checked(token, begun.nonce), begun.next

    def end_address(self) -> str | None:
        """Where a browser is signed out there (RP-Initiated Logout 1.0); None: nowhere."""
        if not self.settings.sign_out_there:
            return None
        try:
            known = self._described()
        except ProviderError:
            return None
        if known.end_session is None:
            return None
        back = {
            "client_id": self.settings.client_id,
            "post_logout_redirect_uri": self.settings.address + "/sign-in",
        }
        return f"{known.end_session}{'&' if '?' in known.end_session else '?'}{urlencode(back)}"

    # --- parts ---

    def _take(self, told: str, held: str) -> _Begun:
        """The sign-in that was begun; it works once, and in the browser that began it."""
        now = self._clock()
        if not (told and held and secrets.compare_digest(told.encode(), held.encode())):
            raise ProviderError("begun", "this browser began no such sign-in")
        with self._guard:
            begun = self._begun.pop(told, None)
        if begun is None or now > begun.at_s + BEGUN_S:
            raise ProviderError("begun", "the sign-in was used already, or took too long")
        return begun

    def _exchanged(self, known: _Known, code: str, verifier: str) -> str:
        """The ID token for a code (RFC 6749, 4.1.3; how the client says who it is: 2.3.1)."""
        import httpx

        mine = self.settings
        asked = {"grant_type": "authorization_code", "code": code, "code_verifier": verifier}
        asked["redirect_uri"] = mine.return_address
        named: httpx.BasicAuth | None = None
        if mine.client_secret is None:
            asked["client_id"] = mine.client_id
        elif known.auth_method == "client_secret_post":
            asked |= {"client_id": mine.client_id, "client_secret": mine.client_secret}
        else:
            named = httpx.BasicAuth(quote_plus(mine.client_id), quote_plus(mine.client_secret))
        try:
            with httpx.Client(timeout=ANSWERS_S, verify=self._trust) as client:
                answer = client.post(
                    known.token, data=asked, auth=named or httpx.USE_CLIENT_DEFAULT, headers=JSON
                )
        except httpx.HTTPError as error:
            raise ProviderError("down", f"{type(error).__name__} at its token endpoint") from error
        if answer.status_code >= 500:
            raise ProviderError("down", f"it answers {answer.status_code} at its token endpoint")
        try:
            told = answer.json()
        except ValueError as error:
            raise ProviderError("refused", "its answer to the code cannot be read") from error
        if isinstance(told, dict) and "error" in told:
            what = f"{told['error']} {told.get('error_description') or ''}".strip()
            raise ProviderError("refused", f"it did not take the code: {what}")
        token = told.get("id_token") if isinstance(told, dict) else None
        if not isinstance(token, str):
            raise ProviderError("refused", "its answer holds no ID token")
        return token

    def _checked(self, token: str, nonce: str) -> Identity:
        """Whom an ID token vouches for (OpenID Connect Core 1.0, 3.1.3.7)."""
        claims, now, mine = self._verified(token), self._clock(), self.settings
        if claims.get("iss") != mine.issuer:
            raise ProviderError("refused", "the ID token is of another issuer")
        audience = claims.get("aud")
        audiences = audience if isinstance(audience, list) else [audience]
        if mine.client_id not in audiences:
            raise ProviderError("refused", "the ID token is for another program")
        if (len(audiences) > 1 or "azp" in claims) and claims.get("azp") != mine.client_id:
            raise ProviderError("refused", "the ID token was made for another program")
        ends, made, begins = (_time(claims, name) for name in ("exp", "iat", "nbf"))
        if ends is None or made is None:
            raise ProviderError("refused", "the ID token does not say when it was made and ends")
        if now >= ends + LEEWAY_S:
            raise ProviderError("refused", "the ID token has expired")
        if max(made, begins or 0.0) > now + LEEWAY_S or made < now - OLDEST_S - LEEWAY_S:
            raise ProviderError("refused", "the ID token is of another time: compare the clocks")
        said = claims.get("nonce")
        if not isinstance(said, str) or not secrets.compare_digest(said.encode(), nonce.encode()):
            raise ProviderError("refused", "the ID token is of another sign-in")
        subject = claims.get("sub")
        if not isinstance(subject, str) or not 0 < len(subject) <= 255:
            raise ProviderError("refused", "the ID token says nobody")
        groups = _texts(_claim(claims, mine.claim))
        name = _claim(claims, mine.name_claim)
        return Identity(
            issuer=mine.issuer,
            subject=subject,
            name=name if isinstance(name, str) and name.strip() else subject,
            groups=groups,
            role=mine.role(groups),
        )

    def _verified(self, token: str) -> dict[str, Any]:
        """Claims of a token that the provider's key has signed; its keys are asked for again where it has a new one."""
        from joserfc import jwt
        from joserfc.errors import JoseError

        for again in (False, True):
            known = self._described(new_keys=again)
            try:
                return dict(jwt.decode(token, known.keys, algorithms=list(ALGORITHMS)).claims)
            except (JoseError, ValueError, TypeError, KeyError) as error:
                failed = error
        raise ProviderError("refused", f"the ID token is not signed by the provider's keys ({failed})")

    def _described(self, *, new_keys: bool = False) -> _Known:
        """What the provider says of itself, and its keys."""
        with self._asking:
            now, known = self._clock(), self._known
            if known is not None and now < known.at_s + (KEYS_AGAIN_S if new_keys else KNOWN_S):
                return known
            if self._down is not None and now < self._down[0] + DOWN_S:
                raise ProviderError("down", self._down[1])
            try:
                found = self._ask(now)
            except ProviderError as error:
                self._down = now, error.detail
                raise
            self._known, self._down = found, None
            return found

    def _ask(self, now: float) -> _Known:
        from joserfc.errors import JoseError
        from joserfc.jwk import KeySet

        issuer = self.settings.issuer
        said = self._json(issuer.rstrip("/") + "/.well-known/openid-configuration")
        if said.get("issuer") != issuer:
            raise ProviderError(
                "down", f"it calls itself {said.get('issuer')!r}, the settings say {issuer!r}"
            )
        ends = said.get("end_session_endpoint")
        keys_at = _endpoint(said, "jwks_uri")
        try:
            keys = KeySet.import_key_set(self._json(keys_at))  # type: ignore[arg-type]
        except (JoseError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise ProviderError("down", f"its keys cannot be read ({error})") from error
        return _Known(
            authorization=_endpoint(said, "authorization_endpoint"),
            token=_endpoint(said, "token_endpoint"),
            end_session=None if ends is None else _endpoint(said, "end_session_endpoint"),
            auth_method=self._auth_method(said),
            names_itself=said.get("authorization_response_iss_parameter_supported") is True,
            keys=keys,
            at_s=now,
        )

    def _auth_method(self, said: Mapping[str, Any]) -> str:
        if self.settings.client_secret is None:
            return "none"
        methods = said.get("token_endpoint_auth_methods_supported") or ["client_secret_basic"]
        wanted = ("client_secret_basic", "client_secret_post")
        return next((one for one in wanted if one in methods), wanted[0])

    def _json(self, address: str) -> dict[str, Any]:
        import httpx

        try:
            with httpx.Client(timeout=ANSWERS_S, verify=self._trust) as client:
                told = client.get(address, headers=JSON).raise_for_status().json()
        except httpx.HTTPStatusError as error:
            what = f"it answers {error.response.status_code} at {urlsplit(address).path}"
            raise ProviderError("down", what) from error
        except httpx.HTTPError as error:
            raise ProviderError(
                "down", f"{urlsplit(address).netloc}: {error or type(error).__name__}"
            ) from error
        except ValueError as error:
            raise ProviderError("down", f"what it says at {urlsplit(address).path} is not JSON") from error
        if not isinstance(told, dict):
            raise ProviderError("down", f"what it says at {urlsplit(address).path} is no object")
        return told


def _trust(settings: ProviderSettings) -> ssl.SSLContext:
    try:
        return ssl.create_default_context(cafile=settings.ca_file)
    except (ssl.SSLError, OSError) as error:
        what = f"holds no certificates ({getattr(error, 'reason', None) or error})"
        raise RequestError(str(settings.ca_file), what, remedy="name certificates as PEM") from error


def _endpoint(said: Mapping[str, Any], name: str) -> str:
    address = said.get(name)
    parts = urlsplit(address) if isinstance(address, str) else None
    if parts is None or not parts.hostname:
        raise ProviderError("down", f"it says no {name}")
    if parts.scheme != "https" and not (parts.scheme == "http" and is_loopback(parts.hostname)):
        raise ProviderError("down", f"its {name} can be read along on the way")
    return str(address)


def _time(claims: Mapping[str, Any], name: str) -> float | None:
    found = claims.get(name)
    return float(found) if isinstance(found, int | float) and not isinstance(found, bool) else None


def _claim(claims: Mapping[str, Any], name: str) -> Any:
    """By its name, else by the names of objects within each other, with full stops between them."""
    if name in claims:
        return claims[name]
    found: Any = claims
    for part in name.split("."):
        found = found.get(part) if isinstance(found, dict) else None
    return found


def _texts(found: Any) -> tuple[str, ...]:
    each = [found] if isinstance(found, str) else found if isinstance(found, list) else []
    return tuple(one for one in each[:MOST_GROUPS] if isinstance(one, str))
