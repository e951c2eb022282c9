"""Which requests reach the studio: those of its own page, and of programs on the right address.

A browser sends the cookies and the reach of its user with every page that it opens, so any web page
could connect to a studio on the same machine. The Origin header names the page that connects; the
Host header names the address that the browser looked up, which a hostile name server may point
anywhere (DNS rebinding). Both are checked before the handshake.
"""

import socket
from collections.abc import Sequence
from dataclasses import dataclass
from ipaddress import IPv6Address, ip_address
from urllib.parse import urlsplit

from websockets.http11 import Request

from t2twin.core.errors import T2TwinError

OWN_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
"""Names of this machine for itself (RFC 6761, RFC 1122, RFC 4291)."""

PORTS = {"http": 80, "https": 443}
"""Ports that an origin may leave out (RFC 9110)."""


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
    """An origin such as https://lab.example. Raises T2TwinError for anything else."""
    try:
        parts = urlsplit(text)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port, parts = None, None, urlsplit("")
    whole = f"{parts.scheme}://{parts.netloc}"
    if not host or parts.scheme not in PORTS or text.lower() != whole.lower() or "@" in text:
        raise T2TwinError(
            f"{text[:80]!r} is not an origin; give http or https, a host, and the port where it is "
            "another than theirs, as in https://lab.example:8443"
        )
    return Origin(parts.scheme, host.rstrip("."), port or PORTS[parts.scheme])


class Gate:
    """Checks the Host and Origin headers of requests to one address.

    host: what the server listens at. allowed: more origins whose pages may connect, such as that
    of a proxy. Raises T2TwinError for an origin that is none.
    """

    def __init__(self, host: str, allowed: Sequence[str] = ()) -> None:
        self.allowed = frozenset(read_origin(each) for each in allowed)
        self._names = OWN_NAMES | {each.host for each in self.allowed} | {host.lower()}
        if host not in OWN_NAMES:
            name = socket.gethostname().lower()
            self._names |= {name, f"{name}.local"}

    def refusal(self, request: Request, local_address: str) -> str:
        """Why a request is refused, in one sentence; empty where it is not.

        local_address: the address of this machine that it came to.
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
                f"a request for the host {given[:80]!r} was refused; start the studio with "
                f"--allow-origin http://{given[:80]} if that is its address"
            )
        for text in request.headers.get_all("Origin"):
            if not self._may_connect(text, host, names):
                return (
                    f"a request of a page of {text[:80]!r} was refused; start the studio with "
                    "--allow-origin if such pages may use it"
                )
        return ""

    def _may_connect(self, text: str, asked: Origin, names: frozenset[str]) -> bool:
        """Whether a page of this origin may connect: the studio's own, or an allowed one."""
        try:
            origin = read_origin(text)
        except T2TwinError:
            return False
        if origin in self.allowed:
            return True
        # The Host header has no scheme, so it leaves out the port of either.
        ports = {asked.port, PORTS["https"] if asked.port == PORTS["http"] else asked.port}
        return origin.host in names and origin.port in ports


def _plain_address(address: str) -> str:
    """An address as a Host header names it: an IPv4 address within IPv6 as IPv4."""
    ip = ip_address(address.partition("%")[0])
    mapped = ip.ipv4_mapped if isinstance(ip, IPv6Address) else None
    return str(mapped or ip)
