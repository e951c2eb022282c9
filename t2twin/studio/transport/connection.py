"""Connection of one client, which checks and throttles its messages.

viser has no limits for messages, so this module replaces the connections of its WebSocket server.
"""

import asyncio
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from threading import Lock
from typing import Any, NoReturn, cast

import viser
from websockets.asyncio import server as websocket_server
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosedError
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from t2twin.core.errors import T2TwinError
from t2twin.studio.transport.log import log
from t2twin.studio.transport.messages import read_message
from t2twin.studio.transport.origin_check import OriginCheck

MAX_MESSAGE = 2**20
"""Maximum size of a message of a client, bytes: twice a part of an upload (512 KiB in viser)."""

MAX_CLIENTS = 8
"""Maximum number of pages (assumed; each uses about 50 MB and the same processors)."""

MAX_SOCKETS = 256
"""Maximum number of open sockets, including those of pages that are being loaded (assumed)."""

MESSAGES_PER_S, MESSAGE_BURST = 200.0, 400.0
"""Messages of one client that are read per second, and at once (assumed: three times the rate of a
drag in a browser)."""

MAX_UNSENT = 512
"""Number of unsent messages to a client above which none of its own are read: twice the number of a
new page."""

UNSENT_POLL_S = 0.05
"""Polling period for the unsent messages, s."""

SEND_TIMEOUT_S, FIRST_MESSAGE_TIMEOUT_S = 30.0, 60.0
"""Timeouts for sending a message and for a client's first message, s (assumed: a slow network, and
a browser that loads the page)."""

MAX_REFUSED = 20
"""Number of refused messages after which a client is disconnected (assumed)."""

POLICY_VIOLATION = 1008
"""Close code (RFC 6455)."""

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")
"""WebSocket subprotocol of viser's page; any other is of another version."""


class Connection(ServerConnection):
    """A WebSocket connection with limits.

    The studio sets check, which returns whether a valid message is passed to viser and raises
    T2TwinError for one that no page sends, and unsent, the number of unsent messages.
    """

    def __init__(self, *arguments: Any, sockets: set["Connection"], **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.check: Callable[[Any], bool] = lambda message: True
        self.unsent: Callable[[], int] = lambda: 0
        self._sockets = sockets
        self._received_first, self._refused = False, 0
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
        """The next valid message."""
        while True:
            timeout_s = None if self._received_first else FIRST_MESSAGE_TIMEOUT_S
            try:
                async with asyncio.timeout(timeout_s):
                    raw = await super().recv(decode)
            except TimeoutError:
                await self._disconnect(f"it sent nothing for {timeout_s:g} s")
            self._received_first = True
            await self._throttle()
            try:
                if self.check(read_message(raw)):
                    return raw
            except T2TwinError as error:
                self._refused += 1
                if self._refused >= MAX_REFUSED:
                    await self._disconnect(f"it sent {MAX_REFUSED} invalid messages: {error}")
                log(f"a message of a client was ignored: {error}")

    async def send(self, message: Any, text: bool | None = None) -> None:
        """Sends a message; disconnects a client that does not read it in time."""
        try:
            async with asyncio.timeout(SEND_TIMEOUT_S):
                await super().send(message, text)
        except TimeoutError:
            log(f"a client was disconnected; it read no messages for {SEND_TIMEOUT_S:g} s")
            self.transport.abort()
            raise ConnectionClosedError(None, None) from None

    async def _disconnect(self, reason: str) -> NoReturn:
        log(f"a client was disconnected; {reason}")
        await self.close(POLICY_VIOLATION)
        raise ConnectionClosedError(None, None)

    async def _throttle(self) -> None:
        """Waits until the next message may be read. By then viser has handled the previous ones,
        because it handles them in tasks of the same event loop."""
        now_s = self.loop.time()
        refill = MESSAGES_PER_S * (now_s - self._refilled_s)
        self._tokens = min(MESSAGE_BURST, self._tokens + refill) - 1.0
        self._refilled_s = now_s
        await asyncio.sleep(max(0.0, -self._tokens / MESSAGES_PER_S))
        while self.unsent() > MAX_UNSENT:
            await asyncio.sleep(UNSENT_POLL_S)


_serving = Lock()
"""Held while the server function is replaced, so that two studios do not start at once."""


@contextmanager
def guarded_server(origin_check: OriginCheck) -> Iterator[None]:
    """Within the block, viser starts its server with a check of origins and with Connections."""
    serve = websocket_server.serve

    def guarded(handler: Any, host: str, port: int, **options: Any) -> Any:
        sockets: set[Connection] = set()
        page = options["process_request"]

        def process_request(connection: ServerConnection, request: Request) -> Response | None:
            refusal = _refuse(origin_check, connection, request, sockets)
            return refusal or _with_policy(page(connection, request), request, origin_check)

        logger = logging.Logger("t2twin.studio", logging.WARNING)
        logger.addHandler(_Lines())
        asyncio.get_running_loop().set_exception_handler(_log_unexpected)
        return serve(handler, host, port, **options | {
            "process_request": process_request,
            "max_size": MAX_MESSAGE,
            "logger": logger,
            "create_connection": partial(Connection, sockets=sockets),
        })  # fmt: skip

    with _serving:
        websocket_server.serve = guarded  # pyright: ignore[reportAttributeAccessIssue]
        try:
            yield
        finally:
            websocket_server.serve = serve


def _refuse(
    origin_check: OriginCheck,
    connection: ServerConnection,
    request: Request,
    sockets: set[Connection],
) -> Response | None:
    """The response to a refused request, which is logged; None for an accepted request."""
    status = HTTPStatus.FORBIDDEN
    refusal = origin_check.refusal(request, connection.local_address[0])
    if not refusal and request.headers.get_all("Upgrade"):
        protocols = ",".join(request.headers.get_all("Sec-WebSocket-Protocol"))
        if PROTOCOL not in [each.strip() for each in protocols.split(",")]:
            status = HTTPStatus.BAD_REQUEST
            refusal = f"a connection was refused; expected {PROTOCOL}: reload the page"
        elif sum(each.subprotocol is not None for each in sockets) >= MAX_CLIENTS:
            status = HTTPStatus.SERVICE_UNAVAILABLE
            refusal = f"a connection was refused; {MAX_CLIENTS} pages are open"
    if not refusal:
        return None
    log(refusal)
    return connection.respond(status, refusal + "\n")


def _with_policy(
    response: Response | None, request: Request, origin_check: OriginCheck
) -> Response | None:
    """The response with a content security policy.

    viser's page connects to the address in its link and obeys the server there. The policy
    restricts these addresses, so that a forged link cannot connect it to another server, and
    prevents other sites from embedding the page.
    """
    if response is not None:
        host = cast(str, request.headers["Host"])
        sites = " ".join(origin_check.allowed)
        sockets = f"ws://{host} wss://{host} {sites.replace('http', 'ws')}"
        response.headers["Content-Security-Policy"] = (
            f"connect-src 'self' data: blob: {sites} {sockets}; frame-ancestors 'self' {sites}"
        )
    return response


class _Lines(logging.Handler):
    """Prints errors of the WebSocket server as lines instead of tracebacks."""

    def emit(self, record: logging.LogRecord) -> None:
        error = record.exc_info[1] if record.exc_info else None
        if record.levelno >= logging.ERROR and record.msg != "opening handshake failed":
            _log_unexpected(None, {"message": record.getMessage(), "exception": error})


def _log_unexpected(loop: Any, context: dict[str, Any]) -> None:
    """Logs an unhandled exception."""
    log(f"the studio continues after an error: {context['message']} ({context.get('exception')!r})")
