"""Checks the Origin and Host headers of requests before the handshake.

Any web page that a user opens could connect to a studio on the same machine. The Origin header
contains the site of the connecting page. The Host header contains the name that the browser
resolved, which a hostile name server may direct to this machine (DNS rebinding).
"""

import socket
from collections.abc import Sequence
from dataclasses import dataclass
from ipaddress import IPv6Address, ip_address
from urllib.parse import urlsplit

from websockets.http11 import Request

from t2twin.core.errors import T2TwinError

OWN_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
"""Loopback names (RFC 6761, RFC 1122, RFC 4291)."""

PORTS = {"http": 80, "https": 443}
"""Default ports (RFC 9110)."""


@dataclass(frozen=True)
class Origin:
    """Scheme, host and port of a page, as in the Origin header."""

    scheme: str
    host: str
    port: int

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}" + (
            "" if PORTS[self.scheme] == self.port else f":{self.port}"
        )


def read_origin(text: str) -> Origin:
    """Parses an origin such as https://lab.example. Raises T2TwinError for anything else."""
    try:
        parts = urlsplit(text)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port, parts = None, None, urlsplit("")
    whole = f"{parts.scheme}://{parts.netloc}"
    if not host or parts.scheme not in PORTS or text.lower() != whole.lower() or "@" in text:
        raise T2TwinError(
            f"{text[:80]!r} is not an origin; expected a scheme (http or https), a host and an "
            "optional port, such as https://lab.example:8443"
        )
    return Origin(parts.scheme, host.rstrip("."), port or PORTS[parts.scheme])


class OriginCheck:
    """Checks the Host and Origin headers of requests to one address.

    host: address of the server. allowed: additional origins whose pages may connect, such as that
    of a proxy. Raises T2TwinError for an invalid origin.
    """

    def __init__(self, host: str, allowed: Sequence[str] = ()) -> None:
        self.allowed = frozenset(read_origin(each) for each in allowed)
        self._names = OWN_NAMES | {each.host for each in self.allowed} | {host.lower()}
        if host not in OWN_NAMES:
            name = socket.gethostname().lower()
            self._names |= {name, f"{name}.local"}

    def refusal(self, request: Request, local_address: str) -> str:
        """The reason why a request is refused; empty for an accepted request.

        local_address: address of this machine that received the request.
        """
        names = self._names | {_plain_address(local_address)}
        hosts = request.headers.get_all("Host")
        try:
            (given,) = hosts
            host = read_origin(f"http://{given}")
        except (ValueError, T2TwinError):
            return f"a request for the host {', '.join(hosts)[:80]!r} was refused"
        if host.host not in names:
            return (
                f"a request for the host {given[:80]!r} was refused; if this is the address of the "
                f"studio, start it with --allow-origin http://{given[:80]}"
            )
        for text in request.headers.get_all("Origin"):
            if not self._may_connect(text, host, names):
                return (
                    f"a request of a page of {text[:80]!r} was refused; to allow such pages, start "
                    "the studio with --allow-origin"
                )
        return ""

    def _may_connect(self, text: str, host: Origin, names: frozenset[str]) -> bool:
        """Whether an origin is that of the studio or an allowed one."""
        try:
            origin = read_origin(text)
        except T2TwinError:
            return False
        if origin in self.allowed:
            return True
        # The Host header has no scheme, so a missing port may be that of either scheme.
        ports = {host.port, PORTS["https"] if host.port == PORTS["http"] else host.port}
        return origin.host in names and origin.port in ports


def _plain_address(address: str) -> str:
    """An address as in a Host header: an IPv4-mapped IPv6 address becomes an IPv4 address."""
    ip = ip_address(address.partition("%")[0])
    mapped = ip.ipv4_mapped if isinstance(ip, IPv6Address) else None
    return str(mapped or ip)
