"""Which pages may connect: checks of the Origin and Host headers, before viser handles a request.

Any web page that a user opens could connect to a studio on the same machine. The Origin header
contains the site of the connecting page. The Host header contains the name that the browser
resolved, which a hostile name server may direct to this machine (DNS rebinding).
"""

import socket
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from http import HTTPStatus
from ipaddress import IPv6Address, ip_address
from threading import Lock
from typing import Any
from urllib.parse import urlsplit

from websockets.asyncio import server as websocket_server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from t2twin.core.errors import T2TwinError
from t2twin.studio.tasks import log

MAX_MESSAGE = 2**20
"""Maximum size of a message of a page, bytes: twice a part of an upload (512 KiB in viser)."""

OWN_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
"""Loopback names (RFC 6761, RFC 1122, RFC 4291)."""

PORTS = {"http": 80, "https": 443}
"""Default ports (RFC 9110)."""


def read_origin(text: str) -> str:
    """An origin such as https://lab.example as browsers send it: in lower case, without the default
    port. Raises T2TwinError for anything else."""
    try:
        parts = urlsplit(text.lower())
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port, parts = None, None, urlsplit("")
    whole = f"{parts.scheme}://{parts.netloc}"
    if not host or parts.scheme not in PORTS or text.lower() != whole or "@" in text:
        raise T2TwinError(
            f"{text[:80]!r} is not an origin; expected a scheme (http or https), a host and an "
            "optional port, such as https://lab.example:8443"
        )
    default = port is None or port == PORTS[parts.scheme]
    return whole.removesuffix(f":{port}") if default else whole


class OriginCheck:
    """Checks the Host and Origin headers of requests to one address.

    host: address of the server. allowed: additional origins whose pages may connect, such as that
    of a proxy. Raises T2TwinError for an invalid origin.
    """

    def __init__(self, host: str, allowed: Sequence[str] = ()) -> None:
        self._allowed = frozenset(map(read_origin, allowed))
        self._names = OWN_NAMES | {urlsplit(each).hostname for each in self._allowed}
        self._names |= {host.lower()}
        if host not in OWN_NAMES:
            name = socket.gethostname().lower()
            self._names |= {name, f"{name}.local"}

    def refusal(self, request: Request, local_address: str) -> str:
        """The reason why a request is refused; empty for an accepted request.

        local_address: address of this machine that received the request.
        """
        hosts = request.headers.get_all("Host")
        try:
            (given,) = hosts
            name = urlsplit(read_origin(f"http://{given}")).hostname
        except (ValueError, T2TwinError):
            return f"a request for the host {', '.join(hosts)[:80]!r} was refused"
        if name not in self._names | {_plain_address(local_address)}:
            return (
                f"a request for the host {given[:80]!r} was refused; if this is the address of the "
                f"studio, start it with --allow-origin http://{given[:80]}"
            )
        # The Host header has no scheme, so it may be that of either scheme.
        own = {read_origin(f"{scheme}://{given}") for scheme in PORTS}
        for origin in request.headers.get_all("Origin"):
            if origin.lower() not in self._allowed | own:
                return (
                    f"a request of a page of {origin[:80]!r} was refused; to allow such pages, "
                    "start the studio with --allow-origin"
                )
        return ""

    def policy(self, host: str) -> str:
        """Content security policy of the page. host: the Host header.

        viser's page connects to the address in its link and obeys the server there. The policy
        restricts these addresses, so that a forged link cannot connect it to another server, and
        prevents other sites from embedding the page.
        """
        sites = " ".join(self._allowed)
        sockets = f"ws://{host} wss://{host} {sites.replace('http', 'ws')}"
        return f"connect-src 'self' data: blob: {sites} {sockets}; frame-ancestors 'self' {sites}"


_serving = Lock()
"""Held while the server function is replaced, so that two studios do not start at once."""


@contextmanager
def checked_server(origin_check: OriginCheck) -> Iterator[None]:
    """Within the block, viser starts its server with a check of origins; it has no option for it.

    Refused requests are logged, and their response is the reason.
    """
    serve = websocket_server.serve

    def checked(handler: Any, host: str, port: int, **options: Any) -> Any:
        page = options["process_request"]

        def process_request(connection: ServerConnection, request: Request) -> Response | None:
            refusal = origin_check.refusal(request, connection.local_address[0])
            if refusal:
                log(refusal)
                return connection.respond(HTTPStatus.FORBIDDEN, refusal + "\n")
            response = page(connection, request)
            if response is not None:
                policy = origin_check.policy(request.headers["Host"])
                response.headers["Content-Security-Policy"] = policy
            return response

        options |= {"process_request": process_request, "max_size": MAX_MESSAGE}
        return serve(handler, host, port, **options)

    with _serving:
        websocket_server.serve = checked  # pyright: ignore[reportAttributeAccessIssue]
        try:
            yield
        finally:
            websocket_server.serve = serve


def _plain_address(address: str) -> str:
    """An address as in a Host header: an IPv4-mapped IPv6 address becomes an IPv4 address."""
    ip = ip_address(address.partition("%")[0])
    mapped = ip.ipv4_mapped if isinstance(ip, IPv6Address) else None
    return str(mapped or ip)
