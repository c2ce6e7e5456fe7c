# Copyright 2026 piezo_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
A small HTTP server on loopback for one page: its data, and one button.

What it refuses: requests without the secret of its address, other hosts than loopback in ``Host``
(a name that was made to point here by DNS), other origins, requests with a body, and heads of more
than 16 kB. Every connection ends after one answer, and after 10 s whatever happens; of more than 16
at once the further ones are closed unanswered. So nothing that a client does, or leaves undone,
takes more than a bounded share of this process.
"""

import contextlib
import hmac
import http.server
import io
import json
import secrets
import socket
import socketserver
import threading
import time
from collections.abc import Callable
from http import HTTPStatus
from typing import Any, Final
from urllib.parse import parse_qsl, urlsplit

__all__ = ['LOOPBACK', 'PageServer']

LOOPBACK: Final = '127.0.0.1'
_LOOPBACK_NAMES: Final = (LOOPBACK, 'localhost')
_MOST_CONNECTIONS: Final = 16
_LONGEST_HEAD: Final = 16_384
_LONGEST_CONNECTION_S: Final = 10.0
_LOOK_S: Final = 0.25
_LAST_ANSWERS_S: Final = 0.5
_SHORT_S: Final = 0.01
_HEADERS: Final = {
    'Cache-Control': 'no-store',
    'Cross-Origin-Opener-Policy': 'same-origin',
    'Cross-Origin-Resource-Policy': 'same-origin',
    'Referrer-Policy': 'no-referrer',
    'X-Content-Type-Options': 'nosniff',
    'X-Frame-Options': 'DENY',
}
_POLICY: Final = (
    "default-src 'none'; connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'")


class PageServer:
    """
    Serves a page, its data, and a button until it is closed.

    Parameters
    ----------
    make_page : callable
        Takes the nonce that its scripts and style sheets must bear, and returns the HTML.
    data : callable
        Takes the parameters of the query and returns what the page shows, for JSON.
    press : callable
        Does what the button does.
    port : int
        The port, 0 for any that is free.

    Raises
    ------
    OSError
        If the port is not to be had.

    Attributes
    ----------
    address : str
        Where the page is, the secret included.

    """

    def __init__(
        self, make_page: Callable[[str], str], data: Callable[[dict[str, str]], Any],
        press: Callable[[], None], *, port: int = 0,
    ) -> None:
        nonce, secret = secrets.token_urlsafe(16), secrets.token_urlsafe(16)
        policy = f"{_POLICY}; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'"
        self._server = _Server((LOOPBACK, port), _Handler)
        self._server.content = _Content(
            f'/{secret}/', make_page(nonce).encode(), policy, data, press)
        self.address = f'http://{LOOPBACK}:{self._server.server_address[1]}/{secret}/'
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(_LOOK_S,), name='live view', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Answer no more; a second time it does nothing."""
        if not self._thread.is_alive():
            return
        self._server.shutdown()
        self._server.server_close()
        begun_s = time.monotonic()
        while self._server.is_answering() and time.monotonic() - begun_s < _LAST_ANSWERS_S:
            time.sleep(_SHORT_S)
        self._server.end_connections()
        self._thread.join()


class _Content:
    """What the server answers with."""

    def __init__(
        self, root: str, page: bytes, policy: str, data: Callable[[dict[str, str]], Any],
        press: Callable[[], None],
    ) -> None:
        self._root = root
        self._page = page
        self._policy = policy
        self._data = data
        self._press = press

    def answer(
        self, method: str, target: str,
    ) -> tuple[HTTPStatus, str, bytes, dict[str, str]]:
        """Return status, media type, body and further headers for a request."""
        place = urlsplit(target)
        root, name = place.path[:len(self._root)], place.path[len(self._root):]
        if not hmac.compare_digest(root.encode(), self._root.encode()):
            return _refusal(HTTPStatus.NOT_FOUND, 'nothing here: use the address that was printed')
        allowed = {'': 'GET', 'data': 'GET', 'stop': 'POST'}
        if name not in allowed:
            return _refusal(HTTPStatus.NOT_FOUND, 'nothing here')
        if method != allowed[name]:
            return _refusal(
                HTTPStatus.METHOD_NOT_ALLOWED, f'{allowed[name]} is allowed here',
                Allow=allowed[name])
        if name == 'data':
            values = self._data(dict(parse_qsl(place.query, max_num_fields=_MOST_CONNECTIONS)))
            body = json.dumps(values, allow_nan=False).encode()
            return HTTPStatus.OK, 'application/json', body, {}
        if name == 'stop':
            self._press()
            return HTTPStatus.ACCEPTED, 'application/json', b'{}', {}
        return (
            HTTPStatus.OK, 'text/html; charset=utf-8', self._page,
            {'Content-Security-Policy': self._policy})


class _Server(socketserver.ThreadingMixIn, socketserver.TCPServer):
    """A server with bounds on the number and the duration of its connections."""

    allow_reuse_address = True
    daemon_threads = True
    block_on_close = False
    request_queue_size = _MOST_CONNECTIONS
    content: _Content

    def __init__(self, *arguments: Any) -> None:
        self._lock = threading.Lock()
        self._begun_s: dict[socket.socket, float] = {}
        super().__init__(*arguments)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a thread of its own, unless there are too many."""
        with self._lock:
            is_full = len(self._begun_s) >= _MOST_CONNECTIONS
            if not is_full:
                self._begun_s[request] = time.monotonic()
        if is_full:
            self.shutdown_request(request)
        else:
            super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """Forget a connection and close it."""
        with self._lock:
            self._begun_s.pop(request, None)
        super().shutdown_request(request)

    def is_answering(self) -> bool:
        """Return whether a connection is open."""
        with self._lock:
            return bool(self._begun_s)

    def service_actions(self) -> None:
        """End connections that take too long."""
        self.end_connections(_LONGEST_CONNECTION_S)

    def end_connections(self, older_than_s: float = 0.0) -> None:
        """End connections, each in the thread that waits for it; others may come at once."""
        now_s = time.monotonic()
        with self._lock:
            ended = [
                connection for connection, begun_s in self._begun_s.items()
                if now_s - begun_s >= older_than_s]
            for connection in ended:
                del self._begun_s[connection]
                with contextlib.suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: a client that leaves is no event."""


class _Handler(http.server.BaseHTTPRequestHandler):
    """Answers one request."""

    server: _Server
    server_version = 'piezo'
    sys_version = ''

    def setup(self) -> None:
        """Read the head of the request, which is all that it may have."""
        super().setup()
        self.rfile.close()
        self.rfile = io.BufferedReader(io.BytesIO(self._read_head()))  # type: ignore[arg-type]

    def _read_head(self) -> bytes:
        head = bytearray()
        while b'\r\n\r\n' not in head and len(head) <= _LONGEST_HEAD:
            part = self.connection.recv(4096)
            if not part:
                return b''
            head += part
        if len(head) > _LONGEST_HEAD:
            self.wfile.write(
                b'HTTP/1.0 431 Request Header Fields Too Large\r\nConnection: close\r\n\r\n')
            return b''
        return bytes(head)

    def do_GET(self) -> None:
        """Answer with the page or its data."""
        self._answer('GET')

    def do_POST(self) -> None:
        """Press the button."""
        self._answer('POST')

    def _answer(self, method: str) -> None:
        try:
            problem = self._foreign(method)
            answer = (
                _refusal(HTTPStatus.FORBIDDEN, problem) if problem
                else self.server.content.answer(method, self.path))
        except ValueError:  # of an address, a host or a query that is none
            answer = _refusal(HTTPStatus.BAD_REQUEST, 'malformed request')
        self._send(*answer)

    def _foreign(self, method: str) -> str:
        """Return why a request cannot be from the page, '' where it may be."""
        hosts = self.headers.get_all('Host', [])
        if len(hosts) != 1 or urlsplit(f'//{hosts[0]}').hostname not in _LOOPBACK_NAMES:
            return f'Host must be one of {", ".join(_LOOPBACK_NAMES)}'
        origins = self.headers.get_all('Origin', [])
        if origins and origins != [f'http://{hosts[0]}']:
            return 'another origin'
        if method == 'POST' and not origins:
            return 'Origin is missing'
        if self.headers.get('Sec-Fetch-Site', 'none') not in ('same-origin', 'none'):
            return 'another site'
        if self.headers.get('Content-Length', '0') != '0' or 'Transfer-Encoding' in self.headers:
            return 'no body is allowed'
        return ''

    def _send(
        self, status: HTTPStatus, media_type: str, body: bytes, headers: dict[str, str],
    ) -> None:
        self.send_response(status)
        for name, value in {
                **_HEADERS, **headers, 'Content-Type': media_type,
                'Content-Length': str(len(body)), 'Connection': 'close'}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def send_error(
        self, code: int, message: str | None = None, explain: str | None = None,
    ) -> None:
        """Refuse what is no request, in plain text."""
        self.close_connection = True
        with contextlib.suppress(ValueError):
            self._send(*_refusal(HTTPStatus(code), HTTPStatus(code).phrase))

    def log_message(self, *_: Any) -> None:
        """Write nothing: the terminal is for the campaign."""


def _refusal(
    status: HTTPStatus, why: str, **headers: str,
) -> tuple[HTTPStatus, str, bytes, dict[str, str]]:
    return status, 'text/plain; charset=utf-8', f'{why}\n'.encode(), headers
