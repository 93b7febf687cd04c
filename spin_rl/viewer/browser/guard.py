"""Who may talk to the browser view: pages that it served itself, and programs that are no browsers."""

from __future__ import annotations

import contextlib
import inspect
import ipaddress
import socket
from collections.abc import Callable, Iterator
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit


@contextlib.contextmanager
def own_pages_only(host: str) -> Iterator[None]:
    """Let a viser server that is started meanwhile refuse the pages of others.

    Any page in a browser may open a WebSocket to this machine, and says so in its header Origin; one that has
    its own name resolve to this machine says so in Host. viser has no option to look at them.

    Args:
        host: Address that the server listens on.
    """
    from websockets.asyncio import server

    serve = server.serve

    def guarded_serve(*arguments: Any, process_request: Callable[..., Any] | None, **options: Any) -> Any:
        async def check(connection: Any, request: Any) -> Any:
            if not is_own(request.headers.get("Origin"), request.headers.get("Host"), host):
                return connection.respond(HTTPStatus.FORBIDDEN, "Only pages of this server may connect.\n")
            answer = None if process_request is None else process_request(connection, request)
            return await answer if inspect.isawaitable(answer) else answer

        return serve(*arguments, process_request=check, **options)

    server.serve = guarded_serve  # pyright: ignore[reportAttributeAccessIssue]
    try:
        yield
    finally:
        server.serve = serve


def is_own(origin: str | None, asked: str | None, host: str) -> bool:
    """Whether a request is of a page of this server, or of no page.

    Args:
        origin: Header Origin, such as `http://localhost:8080`; programs that are no browsers send none.
        asked: Header Host, such as `localhost:8080`.
        host: Address that the server listens on.
    """
    try:
        name = urlsplit(f"//{asked or ''}").hostname or ""
        page = None if origin is None else urlsplit(origin).netloc
    except ValueError:
        return False
    return _is_this_machine(name, host) and page in (None, asked)


def _is_this_machine(name: str, host: str) -> bool:
    """Whether a name is one that nobody else can have resolve to this machine."""
    if name in ("localhost", host, socket.gethostname().lower(), socket.getfqdn().lower()):
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
