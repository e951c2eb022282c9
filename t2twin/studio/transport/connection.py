"""One client's connection: what comes in is checked and paced, what goes out may not pile up.

viser has no limits of its own and no place to set them, so this replaces the connections of the
WebSocket server below it.
"""

import asyncio
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from threading import Lock
from typing import Any, cast

import viser
from websockets.asyncio import server as websocket_server
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosedError
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from t2twin.core.errors import T2TwinError
from t2twin.studio.transport.gate import Gate
from t2twin.studio.transport.log import log
from t2twin.studio.transport.messages import read_message

MAX_MESSAGE = 2**20
"""Largest message of a client, bytes: twice a part of an upload (viser's page sends 512 KiB)."""

MAX_CLIENTS = 8
"""Most pages at once (assumed; each holds some 50 MB and presses on the same cores)."""

MAX_SOCKETS = 256
"""Most open sockets at once, those of pages that are being loaded among them (assumed)."""

MESSAGES_PER_S, MESSAGE_BURST = 200.0, 400.0
"""Messages of one client that are read in a second, and at once; the rest waits on its side
(assumed: three times what a drag in a browser sends)."""

MAX_UNSENT = 512
"""Messages to a client that has not taken them, from which on none of its own are read: twice what
a new page gets."""

UNSENT_S = 0.05
"""How often such a client is looked at, s."""

SEND_S, HELLO_S = 30.0, 60.0
"""How long a client may take for a message, and for its first one, s (assumed: a slow network, a
browser that loads the page)."""

MAX_REFUSED = 20
"""Messages of one client that are refused before it is closed (assumed: none is a page's)."""

POLICY_VIOLATION = 1008
"""Close code (RFC 6455)."""

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")
"""What viser's page asks for; any other is of another version."""

Check = Callable[[Any], bool]
"""Takes a message that is in form. Gives whether viser is to have it; raises T2TwinError for one
that no page sends."""


class Connection(ServerConnection):
    """check: set by the studio when it knows the client. unsent: how many messages wait for it."""

    def __init__(self, *given: Any, sockets: set["Connection"], **named: Any) -> None:
        super().__init__(*given, **named)
        self.check: Check = lambda message: True
        self.unsent: Callable[[], int] = lambda: 0
        self._sockets = sockets
        self._has_spoken, self._refused = False, 0
        self._tokens, self._refilled_s = MESSAGE_BURST, self.loop.time()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self._sockets.add(self)
        if len(self._sockets) > MAX_SOCKETS:
            log(f"a connection was refused; {MAX_SOCKETS} are open")
            self.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        self._sockets.discard(self)
        super().connection_lost(exc)

    async def recv(self, decode: bool | None = None) -> Any:
        """The next message that viser is to have."""
        while True:
            try:
                async with asyncio.timeout(None if self._has_spoken else HELLO_S):
                    raw = await super().recv(decode)
            except TimeoutError:
                log(f"a client was closed; it sent nothing in {HELLO_S:g} s")
                await self.close(POLICY_VIOLATION)
                raise ConnectionClosedError(None, None) from None
            self._has_spoken = True
            await self._pace()
            try:
                if self.check(read_message(raw)):
                    return raw
            except T2TwinError as error:
                await self._refuse(error)

    async def send(self, message: Any, text: bool | None = None) -> None:
        """Sends a message; a client that does not take it in time is closed."""
        try:
            async with asyncio.timeout(SEND_S):
                await super().send(message, text)
        except TimeoutError:
            log(f"a client was closed; it did not read what it was sent for {SEND_S:g} s")
            self.transport.abort()
            raise ConnectionClosedError(None, None) from None

    async def _pace(self) -> None:
        """Waits until the next message may be read. What came before it has been handled then, as
        viser hands messages to tasks of the same loop."""
        now_s = self.loop.time()
        refill = MESSAGES_PER_S * (now_s - self._refilled_s)
        self._tokens = min(MESSAGE_BURST, self._tokens + refill) - 1.0
        self._refilled_s = now_s
        await asyncio.sleep(max(0.0, -self._tokens / MESSAGES_PER_S))
        while self.unsent() > MAX_UNSENT:
            await asyncio.sleep(UNSENT_S)

    async def _refuse(self, error: T2TwinError) -> None:
        self._refused += 1
        if self._refused < MAX_REFUSED:
            log(f"a message of a client was ignored: {error}")
            return
        log(f"a client was closed after {MAX_REFUSED} messages that no page sends: {error}")
        await self.close(POLICY_VIOLATION)
        raise ConnectionClosedError(None, None)


_serving = Lock()
"""Held while a server is replaced: two studios of one process start one after another."""


@contextmanager
def guarded_server(gate: Gate) -> Iterator[None]:
    """A server that viser starts within the block has a gate before it and Connections in it."""
    serve = websocket_server.serve

    def guarded(handler: Any, host: str, port: int, **named: Any) -> Any:
        sockets: set[Connection] = set()
        page = named["process_request"]

        def process_request(connection: ServerConnection, request: Request) -> Response | None:
            refused = _refused(gate, connection, request, sockets)
            return refused or _with_policy(page(connection, request), request, gate)

        asyncio.get_running_loop().set_exception_handler(_say_unexpected)
        return serve(handler, host, port, **named | {
            "process_request": process_request,
            "max_size": MAX_MESSAGE,
            "logger": _quiet_logger(),
            "create_connection": partial(Connection, sockets=sockets),
        })  # fmt: skip

    with _serving:
        websocket_server.serve = guarded  # pyright: ignore[reportAttributeAccessIssue]
        try:
            yield
        finally:
            websocket_server.serve = serve


def _refused(
    gate: Gate, connection: ServerConnection, request: Request, sockets: set[Connection]
) -> Response | None:
    """The answer to a request that is refused, with a line on standard error."""
    refusal, status = gate.refusal(request, connection.local_address[0]), HTTPStatus.FORBIDDEN
    if not refusal and request.headers.get_all("Upgrade"):
        protocols = ",".join(request.headers.get_all("Sec-WebSocket-Protocol"))
        if PROTOCOL not in [each.strip() for each in protocols.split(",")]:
            status = HTTPStatus.BAD_REQUEST
            refusal = f"a connection was refused; it is not of {PROTOCOL}: load the page again"
        elif sum(each.subprotocol is not None for each in sockets) >= MAX_CLIENTS:
            status = HTTPStatus.SERVICE_UNAVAILABLE
            refusal = f"a connection was refused; {MAX_CLIENTS} pages are open"
    if not refusal:
        return None
    log(refusal)
    return connection.respond(status, refusal + "\n")


def _with_policy(response: Response | None, request: Request, gate: Gate) -> Response | None:
    """The page's files, with the addresses that they may connect to.

    viser's page connects to the address that its link names, and does what it is told from there:
    a link of somebody else must not lead it elsewhere. Nor may a page of another site show it.
    """
    if response is not None:
        host = cast(str, request.headers["Host"])
        sites = " ".join(map(str, gate.allowed))
        sockets = f"ws://{host} wss://{host} {sites.replace('http', 'ws')}"
        response.headers["Content-Security-Policy"] = (
            f"connect-src 'self' data: blob: {sites} {sockets}; frame-ancestors 'self' {sites}"
        )
    return response


def _quiet_logger() -> logging.Logger:
    """The WebSocket server's, whose tracebacks become lines."""

    class Lines(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            error = record.exc_info[1] if record.exc_info else None
            if record.levelno >= logging.ERROR and record.msg != "opening handshake failed":
                _say_unexpected(None, {"message": record.getMessage(), "exception": error})

    logger = logging.Logger("t2twin.studio", logging.WARNING)
    logger.addHandler(Lines())
    return logger


def _say_unexpected(loop: Any, context: dict[str, Any]) -> None:
    """An error that nothing else has taken."""
    log(f"the studio goes on after an error: {context['message']} ({context.get('exception')!r})")
