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

"""The server of the live page: what it answers, what it refuses, and that nothing blocks it."""

import contextlib
import http.client
import socket
import threading
import time
from urllib.parse import urlsplit

import pytest

from piezo_ros.live.view import page_server
from piezo_ros.live.view.page_server import PageServer


class Served:
    """A server, what was asked of it, and how often its button was pressed."""

    def __init__(self):
        self.pressed = 0
        self.server = PageServer(lambda nonce: f'<p>page {nonce}</p>', self.data, self.press)
        place = urlsplit(self.server.address)
        self.port, self.root = place.port, place.path

    def data(self, query):
        if 'number' in query:
            int(query['number'])
        return {'query': query}

    def press(self):
        self.pressed += 1

    def ask(self, method, name='', root=None, body=None, **headers):
        """Return status, headers and body of an answer."""
        connection = http.client.HTTPConnection('127.0.0.1', self.port, timeout=20)
        try:
            connection.request(
                method, (self.root if root is None else root) + name, body=body,
                headers={key.replace('_', '-'): value for key, value in headers.items()})
            answer = connection.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read().decode()
        finally:
            connection.close()

    def open(self):
        return socket.create_connection(('127.0.0.1', self.port), timeout=20)

    @property
    def origin(self):
        return f'http://127.0.0.1:{self.port}'


@pytest.fixture
def served():
    server = Served()
    yield server
    server.server.close()


def test_the_page_its_data_and_its_button(served):
    status, headers, body = served.ask('GET')
    assert status == 200
    assert body.startswith('<p>page ')
    nonce = body[len('<p>page '):-len('</p>')]
    policy = headers['Content-Security-Policy']
    assert f"script-src 'nonce-{nonce}'" in policy
    assert "default-src 'none'" in policy
    assert "frame-ancestors 'none'" in policy
    assert headers['X-Frame-Options'] == 'DENY'
    assert headers['Cache-Control'] == 'no-store'
    assert served.ask('GET', 'data?a=1&b=') [::2] == (200, '{"query": {"a": "1"}}')
    assert served.ask('POST', 'stop', Origin=served.origin)[0] == 202
    assert served.pressed == 1


@pytest.mark.parametrize('headers', [
    {},  # a browser says where a POST comes from
    {'Origin': 'http://evil.example'},
    {'Origin': 'null'},
    {'Origin': 'http://127.0.0.1:1'},
    {'Origin': 'https://127.0.0.1:{port}'},
    {'Origin': '{own}', 'Sec_Fetch_Site': 'cross-site'},
    {'Origin': '{own}', 'Sec_Fetch_Site': 'same-site'},
    # A name that was made to point here.
    {'Origin': 'http://evil.example:{port}', 'Host': 'evil.example:{port}'},
    {'Origin': 'http://localhost.evil.example', 'Host': 'localhost.evil.example'},
    {'Origin': '{own}', 'Host': 'evil.example'},
    {'Origin': '{own}', 'Transfer_Encoding': 'chunked'},
    {'Origin': '{own}', 'Content_Length': '5'}])
def test_no_other_site_presses_the_button(served, headers):
    headers = {
        name: value.format(port=served.port, own=served.origin)
        for name, value in headers.items()}
    assert served.ask('POST', 'stop', **headers)[0] == 403
    assert served.pressed == 0


@pytest.mark.parametrize('headers', [
    {'Origin': 'http://evil.example'}, {'Host': 'evil.example'}, {'Host': '[::1'},
    {'Sec_Fetch_Site': 'cross-site'}])
@pytest.mark.parametrize('name', ['', 'data'])
def test_no_other_site_reads(served, headers, name):
    status, _, body = served.ask('GET', name, **headers)
    assert status in (400, 403)
    assert 'page' not in body
    assert 'query' not in body


@pytest.mark.parametrize('root', ['/', '', '/x/', '/favicon.ico', '/' + 22 * 'a' + '/'])
def test_nothing_is_there_without_the_secret(served, root):
    for method, name in (('GET', ''), ('GET', 'data'), ('POST', 'stop')):
        status, _, body = served.ask(method, name, root=root or '/', Origin=served.origin)
        assert status == 404
        assert served.root not in body
    assert served.pressed == 0


def test_each_server_has_a_secret_of_its_own(served):
    other = Served()
    try:
        assert other.root != served.root
        assert len(other.root) > 20
    finally:
        other.server.close()


def test_a_forwarded_port_is_no_other_site(served):
    host = 'localhost:9000'  # ssh -L 9000:127.0.0.1:PORT
    assert served.ask('GET', Host=host)[0] == 200
    assert served.ask('POST', 'stop', Host=host, Origin=f'http://{host}')[0] == 202


def test_what_is_not_there_is_not_there(served):
    assert served.ask('GET', 'stop')[0] == 405
    assert served.ask('POST', 'data', Origin=served.origin)[0] == 405
    assert served.ask('GET', '../../etc/passwd')[0] == 404
    for method in ('HEAD', 'PUT', 'DELETE', 'OPTIONS', 'TRACE'):
        assert served.ask(method, 'stop')[0] == 501
    assert served.ask('GET', 'data?number=one')[0] == 400
    assert served.ask('GET', 'data?' + '&'.join(f'a{n}=1' for n in range(40)))[0] == 400
    assert served.pressed == 0


@pytest.mark.parametrize('sent', [
    b'\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n', b'\r\n\r\n', b'GET\r\n\r\n',
    b'GET / HTTP/9.9\r\n\r\n', b'GET //[ HTTP/1.1\r\nHost: localhost\r\n\r\n',
    b'POST / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n',
    b'GET / HTTP/1.1\r\n' + 200 * b'a: b\r\n' + b'\r\n'])
def test_what_is_no_request_harms_nothing(served, sent):
    with served.open() as connection:
        connection.sendall(sent)
        while connection.recv(4096):
            pass
    assert served.ask('GET')[0] == 200


def test_a_huge_request_is_refused_before_it_is_read(served):
    with served.open() as connection:
        answer = b''
        try:
            for _ in range(2000):
                connection.sendall(10_000 * b'a')
        except OSError:
            pass
        else:
            pytest.fail('20 MB were taken')
        with contextlib.suppress(OSError):
            answer = connection.recv(100)
    assert not answer or b'431' in answer
    assert served.ask('GET')[0] == 200


def test_connections_that_say_nothing_are_bounded_and_end(served, monkeypatch):
    monkeypatch.setattr(page_server, '_LONGEST_CONNECTION_S', 0.5)
    before = threading.active_count()
    idle = [served.open() for _ in range(100)]
    try:
        time.sleep(0.2)
        assert threading.active_count() - before <= 16
        for connection in idle:
            while connection.recv(100):
                pass
    finally:
        for connection in idle:
            connection.close()
    assert served.ask('GET')[0] == 200


def test_a_reader_that_does_not_read_holds_nothing_up():
    served = Served()
    try:
        served.server._server.content._page = 30_000_000 * b'x'
        with served.open() as connection:
            connection.sendall(f'GET {served.root} HTTP/1.1\r\nHost: localhost\r\n\r\n'.encode())
            time.sleep(0.1)
            assert served.ask('GET', 'data')[0] == 200
            begun_s = time.monotonic()
            served.server.close()
            assert time.monotonic() - begun_s < 5.0
    finally:
        served.server.close()


def test_closing_ends_connections_that_are_open(served):
    with served.open() as connection:
        time.sleep(0.05)
        served.server.close()
        assert connection.recv(10) == b''
    with pytest.raises(OSError, match='refused'):
        served.open()


def test_a_port_that_is_taken_is_an_error(served):
    with pytest.raises(OSError, match='in use'):
        PageServer(lambda nonce: '', dict, lambda: None, port=served.port)
