"""Who may open the page, and who may command: headers looked at before anything else happens."""

import hmac
import ipaddress
from collections.abc import Collection
from urllib.parse import urlsplit

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; require-trusted-types-for 'script'; frame-ancestors "
)
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}


def host_is_ours(host: str, names: Collection[str]) -> bool:
    """Tell whether a Host header names us: by a number, or by one of `names`.

    A page elsewhere can make its own name mean our address (DNS rebinding), but not a number.
    """
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name in names or bool(ipaddress.ip_address(name))
    except ValueError:
        return False


def same_origin(origin: str | None, host: str) -> bool:
    """Tell whether a request comes from a page of ours. Browsers name the origin; who does not is refused."""
    try:
        parts = urlsplit(origin or "")
    except ValueError:
        return False
    return parts.scheme in ("http", "https") and parts.netloc == host


def token_is_right(authorization: str | None, token: str) -> bool:
    """Tell whether an Authorization header has the token, in the same time for right and wrong ones."""
    scheme, _, given = (authorization or "").partition(" ")
    same = hmac.compare_digest(given.encode(errors="replace"), token.encode())
    return same and bool(token) and scheme == "Bearer"


def headers(*, framed: bool) -> dict[str, str]:
    """Return the headers of every answer; a `framed` page may stand inside another, such as Cockpit's."""
    return {**_HEADERS, "Content-Security-Policy": _POLICY + ("*" if framed else "'none'")}
