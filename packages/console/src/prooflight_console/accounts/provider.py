"""Signing in at an OpenID provider by the code flow with PKCE, state and nonce.

See OpenID Connect Core 1.0 and RFC 7636. A pending sign-in is stored here for ten minutes and used once: its
state is in a cookie of the browser that began it, its nonce in the ID token, its code verifier nowhere else.
The ID token is checked by the keys that the provider publishes: signature, issuer, audience, time, nonce. The
libraries implement requests and verification; this module decides what is accepted.
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

    from prooflight_console.accounts.provider_file import ProviderSettings
    from prooflight_console.accounts.roles import Role

BEGUN_S: Final = 600.0
"""Time to finish a sign-in, in which people look up a password and a second factor. [s]"""
MOST_BEGUN: Final = 10_000
"""Largest number of pending sign-ins; the oldest is dropped first."""
METADATA_S: Final = 3600.0
"""Lifetime of the cached metadata and keys of the provider. [s]"""
KEYS_AGAIN_S: Final = 30.0
"""Least time between two requests for the keys, which a token with an unknown key causes. [s]"""
DOWN_S: Final = 5.0
"""Time without requests after a failure: a provider that is down must not block all threads. [s]"""
ANSWERS_S: Final = 10.0
LEEWAY_S: Final = 60.0
"""Tolerated difference between two clocks. [s]"""
OLDEST_S: Final = 600.0
"""Greatest age of an ID token, in addition to the leeway: the provider issued it a moment ago. [s]"""
AT_ONCE: Final = 4
ALGORITHMS: Final = ("RS256", "RS384", "RS512", "PS256", "PS384", "PS512", "ES256", "ES384", "ES512", "EdDSA")
"""Accepted signature algorithms, by a key that only the provider has; never `none` or HMAC."""
MOST_GROUPS: Final = 1000
JSON: Final = {"Accept": "application/json"}


class ProviderError(ProoflightError):
    """A failed sign-in; kind: `down` (no response), `begun` (begin again) or `refused`."""

    def __init__(self, kind: str, detail: str) -> None:
        self.kind, self.detail = kind, visible(detail)[:400]
        super().__init__(self.detail)


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """A person whom the provider vouches for."""

    issuer: str
    subject: str
    """Identifier that stays the same when the name changes."""
    name: str
    groups: tuple[str, ...]
    role: Role | None
    """Role that the groups give; None if none of them is mapped."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Begun:
    nonce: str
    verifier: str
    next: str
    at_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Metadata:
    """Metadata of the provider (OpenID Connect Discovery 1.0) and its keys."""

    authorization: str
    token: str
    end_session: str | None
    auth_method: str
    names_itself: bool
    """Whether it names its issuer when it sends a browser back (RFC 9207)."""
    keys: KeySet
    at_s: float


class Provider:
    """Client of one provider, whose methods block on the network and are called in threads."""

    def __init__(self, settings: ProviderSettings, *, clock: Callable[[], float]) -> None:
        """Create a client. clock: Unix time. [s]

        Raises RequestError if the extra is not installed or the certificates cannot be used.
        """
        try:
            import authlib  # type: ignore[import-untyped]
            import httpx
            import joserfc
        except ImportError as error:
            remedy = 'install it with pip install "prooflight-console[oidc]"'
            raise RequestError("--oidc", f"{error.name} is not installed", remedy=remedy) from error
        del authlib, httpx, joserfc
        self.settings, self._clock = settings, clock
        self._trust = _trust(settings)
        self._begun: OrderedDict[str, _Begun] = OrderedDict()
        self._cached: _Metadata | None = None
        self._down: tuple[float, str] | None = None
        self._guard, self._asking = threading.Lock(), threading.Lock()
        self.limiter = anyio.CapacityLimiter(AT_ONCE)
        """Limit on threads that wait for the provider: pages need threads, whatever the provider does."""

    # --- the flow ---

    def begin(self, *, next: str) -> tuple[str, str]:
        """Begin a sign-in and return the address to redirect to and the state for the browser's cookie.

        next: the page that was requested. Raises ProviderError.
        """
        from authlib.oauth2.rfc6749.parameters import prepare_grant_uri  # type: ignore[import-untyped]
        from authlib.oauth2.rfc7636 import create_s256_code_challenge  # type: ignore[import-untyped]

        metadata = self._metadata()
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
            metadata.authorization,
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

    def finish(self, parameters: Mapping[str, str], *, state: str) -> tuple[Identity, str]:
        """Finish a sign-in and return the person and the page that was requested.

        Parameters
        ----------
        parameters
            Query parameters that the provider sent.
        state
            State in the browser's cookie.

        Raises
        ------
        ProviderError
            If the sign-in is not pending, or the provider's answer is not accepted.
        """
        begun = self._take(parameters.get("state", ""), state)
        if "error" in parameters:
            what = f"{parameters['error']} {parameters.get('error_description', '')}".strip()
            raise ProviderError("refused", f"its message: {what}")
        metadata = self._metadata()
        issuer = parameters.get("iss")
        if issuer != self.settings.issuer and (issuer is not None or metadata.names_itself):
            raise ProviderError("refused", "another provider sent the browser back")
        if not parameters.get("code"):
            raise ProviderError("refused", "it sent no code")
        token = self._exchanged(metadata, parameters["code"], begun.verifier)
        return self._checked(token, begun.nonce), begun.next

    def end_address(self) -> str | None:
        """Return the address of the provider's logout (RP-Initiated Logout 1.0); None if there is none."""
        if not self.settings.sign_out_there:
            return None
        try:
            metadata = self._metadata()
        except ProviderError:
            return None
        if metadata.end_session is None:
            return None
        back = {
            "client_id": self.settings.client_id,
            "post_logout_redirect_uri": self.settings.address + "/sign-in",
        }
        return f"{metadata.end_session}{'&' if '?' in metadata.end_session else '?'}{urlencode(back)}"

    # --- parts ---

    def _take(self, returned: str, stored: str) -> _Begun:
        """Remove and return the pending sign-in; it works once, and in the browser that began it."""
        now = self._clock()
        if not (returned and stored and secrets.compare_digest(returned.encode(), stored.encode())):
            raise ProviderError("begun", "this browser did not start this sign-in")
        with self._guard:
            begun = self._begun.pop(returned, None)
        if begun is None or now > begun.at_s + BEGUN_S:
            raise ProviderError("begun", "the sign-in was used already, or took too long")
        return begun

    def _exchanged(self, metadata: _Metadata, code: str, verifier: str) -> str:
        """Exchange a code for an ID token (RFC 6749, 4.1.3; client authentication: 2.3.1)."""
        import httpx

        mine = self.settings
        request = {"grant_type": "authorization_code", "code": code, "code_verifier": verifier}
        request["redirect_uri"] = mine.return_address
        named: httpx.BasicAuth | None = None
        if mine.client_secret is None:
            request["client_id"] = mine.client_id
        elif metadata.auth_method == "client_secret_post":
            request |= {"client_id": mine.client_id, "client_secret": mine.client_secret}
        else:
            named = httpx.BasicAuth(quote_plus(mine.client_id), quote_plus(mine.client_secret))
        try:
            with httpx.Client(timeout=ANSWERS_S, verify=self._trust) as client:
                answer = client.post(
                    metadata.token, data=request, auth=named or httpx.USE_CLIENT_DEFAULT, headers=JSON
                )
        except httpx.HTTPError as error:
            raise ProviderError("down", f"{type(error).__name__} at its token endpoint") from error
        if answer.status_code >= 500:
            raise ProviderError("down", f"it answers {answer.status_code} at its token endpoint")
        try:
            content = answer.json()
        except ValueError as error:
            raise ProviderError("refused", "its answer to the code cannot be read") from error
        if isinstance(content, dict) and "error" in content:
            what = f"{content['error']} {content.get('error_description') or ''}".strip()
            raise ProviderError("refused", f"it did not accept the code: {what}")
        token = content.get("id_token") if isinstance(content, dict) else None
        if not isinstance(token, str):
            raise ProviderError("refused", "its answer contains no ID token")
        return token

    def _checked(self, token: str, nonce: str) -> Identity:
        """Validate the claims of an ID token and return the person (OpenID Connect Core 1.0, 3.1.3.7)."""
        claims, now, mine = self._verified(token), self._clock(), self.settings
        if claims.get("iss") != mine.issuer:
            raise ProviderError("refused", "the ID token is of another issuer")
        audience = claims.get("aud")
        audiences = audience if isinstance(audience, list) else [audience]
        if mine.client_id not in audiences:
            raise ProviderError("refused", "the ID token is for another program")
        if (len(audiences) > 1 or "azp" in claims) and claims.get("azp") != mine.client_id:
            raise ProviderError("refused", "the ID token was issued for another program")
        ends, issued, begins = (_time(claims, name) for name in ("exp", "iat", "nbf"))
        if ends is None or issued is None:
            raise ProviderError(
                "refused", "the ID token does not state when it was issued and when it expires"
            )
        if now >= ends + LEEWAY_S:
            raise ProviderError("refused", "the ID token has expired")
        if max(issued, begins or 0.0) > now + LEEWAY_S or issued < now - OLDEST_S - LEEWAY_S:
            raise ProviderError("refused", "the ID token is not of the present time: compare the clocks")
        returned_nonce = claims.get("nonce")
        if not isinstance(returned_nonce, str) or not secrets.compare_digest(
            returned_nonce.encode(), nonce.encode()
        ):
            raise ProviderError("refused", "the ID token is of another sign-in")
        subject = claims.get("sub")
        if not isinstance(subject, str) or not 0 < len(subject) <= 255:
            raise ProviderError("refused", "the ID token names no user")
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
        """Return the claims of a token with a valid signature; requests new keys once if none fits."""
        from joserfc import jwt
        from joserfc.errors import JoseError

        for again in (False, True):
            metadata = self._metadata(new_keys=again)
            try:
                return dict(jwt.decode(token, metadata.keys, algorithms=list(ALGORITHMS)).claims)
            except (JoseError, ValueError, TypeError, KeyError) as error:
                failed = error
        raise ProviderError("refused", f"the ID token is not signed by the provider's keys ({failed})")

    def _metadata(self, *, new_keys: bool = False) -> _Metadata:
        """Return the metadata and keys of the provider, from the cache if they are recent."""
        with self._asking:
            now, cached = self._clock(), self._cached
            if cached is not None and now < cached.at_s + (KEYS_AGAIN_S if new_keys else METADATA_S):
                return cached
            if self._down is not None and now < self._down[0] + DOWN_S:
                raise ProviderError("down", self._down[1])
            try:
                metadata = self._ask(now)
            except ProviderError as error:
                self._down = now, error.detail
                raise
            self._cached, self._down = metadata, None
            return metadata

    def _ask(self, now: float) -> _Metadata:
        from joserfc.errors import JoseError
        from joserfc.jwk import KeySet

        issuer = self.settings.issuer
        document = self._json(issuer.rstrip("/") + "/.well-known/openid-configuration")
        if document.get("issuer") != issuer:
            raise ProviderError(
                "down",
                f"it states as its issuer {document.get('issuer')!r}, but the settings state {issuer!r}",
            )
        ends = document.get("end_session_endpoint")
        keys_at = _endpoint(document, "jwks_uri")
        try:
            keys = KeySet.import_key_set(self._json(keys_at))  # type: ignore[arg-type]
        except (JoseError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise ProviderError("down", f"its keys cannot be read ({error})") from error
        return _Metadata(
            authorization=_endpoint(document, "authorization_endpoint"),
            token=_endpoint(document, "token_endpoint"),
            end_session=None if ends is None else _endpoint(document, "end_session_endpoint"),
            auth_method=self._auth_method(document),
            names_itself=document.get("authorization_response_iss_parameter_supported") is True,
            keys=keys,
            at_s=now,
        )

    def _auth_method(self, document: Mapping[str, Any]) -> str:
        if self.settings.client_secret is None:
            return "none"
        methods = document.get("token_endpoint_auth_methods_supported") or ["client_secret_basic"]
        wanted = ("client_secret_basic", "client_secret_post")
        return next((one for one in wanted if one in methods), wanted[0])

    def _json(self, address: str) -> dict[str, Any]:
        import httpx

        try:
            with httpx.Client(timeout=ANSWERS_S, verify=self._trust) as client:
                content = client.get(address, headers=JSON).raise_for_status().json()
        except httpx.HTTPStatusError as error:
            what = f"it answers {error.response.status_code} at {urlsplit(address).path}"
            raise ProviderError("down", what) from error
        except httpx.HTTPError as error:
            raise ProviderError(
                "down", f"{urlsplit(address).netloc}: {error or type(error).__name__}"
            ) from error
        except ValueError as error:
            raise ProviderError("down", f"its answer at {urlsplit(address).path} is not JSON") from error
        if not isinstance(content, dict):
            raise ProviderError("down", f"its answer at {urlsplit(address).path} is not a JSON object")
        return content


def _trust(settings: ProviderSettings) -> ssl.SSLContext:
    try:
        return ssl.create_default_context(cafile=settings.ca_file)
    except (ssl.SSLError, OSError) as error:
        what = f"contains no certificates ({getattr(error, 'reason', None) or error})"
        raise RequestError(str(settings.ca_file), what, remedy="give certificates as PEM") from error


def _endpoint(document: Mapping[str, Any], name: str) -> str:
    address = document.get(name)
    parts = urlsplit(address) if isinstance(address, str) else None
    if parts is None or not parts.hostname:
        raise ProviderError("down", f"it states no {name}")
    if parts.scheme != "https" and not (parts.scheme == "http" and is_loopback(parts.hostname)):
        raise ProviderError("down", f"its {name} is not encrypted: it must begin with https")
    return str(address)


def _time(claims: Mapping[str, Any], name: str) -> float | None:
    value = claims.get(name)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _claim(claims: Mapping[str, Any], name: str) -> Any:
    """Return a claim by its name, else by a path of names of nested objects, separated by full stops."""
    if name in claims:
        return claims[name]
    value: Any = claims
    for part in name.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return value


def _texts(value: Any) -> tuple[str, ...]:
    each = [value] if isinstance(value, str) else value if isinstance(value, list) else []
    return tuple(one for one in each[:MOST_GROUPS] if isinstance(one, str))
