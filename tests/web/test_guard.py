"""The security of the page, row by row: the permitted clients, their origins, and their limits."""

import asyncio
import gzip
import json
import re
import socket

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from baqueano.messages.language import LANGUAGE_VARIABLE
from baqueano.web import SUBPROTOCOL, guard as guarding, run as running, server as serving
from baqueano.web.guard import MAX_FAILURES, TOKEN_LIFETIME_S, Guard, Role
from baqueano.web.http import REPORT_POLICY, RefusedRequest, parse_head, static_files
from baqueano.web.run import PageOptions, show_runs
from baqueano.web.share import network_names, qr_code, url
from tests.web.page_client import Browser, address, browser, drive, folder_of, line_to, recorded_page, request

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'"
)
EVIL = "evil.example"
NAMESPACES = {"http://www.w3.org/2000/svg"}  # names, not addresses: nothing is fetched from them
AS_HTML = re.compile(
    r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function|DOMParser"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return folder_of(tmp_path_factory.mktemp("page") / "runs", circle=drive())


@pytest.fixture
def _static(monkeypatch, tmp_path):
    """Return a folder with the files of the page and a link that leads out of it."""
    (tmp_path / "index.html").write_text("<title>page</title>")
    (tmp_path / "page.js").write_text("let x")
    (tmp_path / "secret.key").write_text("secret")
    (tmp_path / "out.txt").symlink_to("/etc/passwd")
    monkeypatch.setattr(serving, "STATIC", tmp_path)


async def test_ne1_the_page_listens_on_loopback_and_on_its_shared_address(folder):
    async with recorded_page(folder) as server:
        assert [
            listening_socket.getsockname()[0]
            for listener in server._servers
            for listening_socket in listener.sockets
        ] == ["127.0.0.1"]
        with pytest.raises(OSError, match="failed"):
            await asyncio.open_connection("127.0.0.2", server.port)
    async with recorded_page(folder, shared_address="127.0.0.2") as server:
        listening = {
            listening_socket.getsockname()
            for listener in server._servers
            for listening_socket in listener.sockets
        }
        assert listening == {("127.0.0.1", server.port), ("127.0.0.2", server.port)}


async def test_ne3_a_shared_page_prints_a_qr_code_and_an_address_for_each_role(folder, monkeypatch):
    notes, roles = [], []

    async def visit():
        for code in ("web.address", "web.to-stop", "web.to-view"):
            (address,) = (note.figures["url"] for note in notes[1:] if note.code == code)
            host, token = re.fullmatch(r"http://(127\.0\.0\.2:\d+)/\?lang=en#token=(\S+)", address).groups()
            async with connect(
                f"ws://{host}/ws", origin=f"http://{host}", subprotocols=[SUBPROTOCOL]
            ) as line:
                visitor = Browser(line)
                await visitor.send("hello", lang="en", token=token)
                roles.append((await visitor.next("hello"))["role"])

    monkeypatch.setattr(running, "wait_for_end", visit)
    monkeypatch.setattr(running, "own_address", lambda: "127.0.0.2")  # of this machine in its network
    options = PageOptions(folder, share=True, browser=False)
    await show_runs(("circle",), options, notes.append)
    assert roles == ["drive", "stop", "view"]
    assert notes[0] == qr_code(next(note.figures["url"] for note in notes[1:] if note.code == "web.address"))
    assert len(notes[0].splitlines()) > 10
    assert "web.unencrypted" in [note.code for note in notes[1:]]  # the risk of an unencrypted connection


def test_ne1_the_printed_address_contains_its_token_in_the_url_fragment():
    tokens = Guard((), 1).tokens
    assert len(set(tokens.values())) == 3
    assert all(len(token) >= 22 for token in tokens.values())  # 128 bits, six per letter
    address = url("192.168.4.1", 8000, tokens, Role.VIEW)
    assert address == f"http://192.168.4.1:8000/?lang=en#token={tokens[Role.VIEW]}"
    assert "#" not in url("127.0.0.1", 8000, tokens)
    assert len(qr_code(address).splitlines()) > 10
    assert network_names()[0].endswith(".local")


@pytest.mark.parametrize(
    "host",
    [EVIL, "evil.example:{port}", "localhost.:{port}", "127.0.0.1", "127.0.0.1:1", "[::1]:{port}", "", None],
)
async def test_ne2_a_host_that_is_not_served_is_refused_on_every_request(folder, host):
    async with recorded_page(folder, "circle") as server:
        host_name = None if host is None else host.format(port=server.port)
        for path in ("/", "/run/x", "/ws", "/nothing"):
            assert (await request(server, f"GET {path} HTTP/1.1", host=host_name))[0] == 403


async def test_ne2_a_shared_page_accepts_the_local_name_of_its_machine_and_no_other(folder):
    async with recorded_page(folder, "circle", shared_address="127.0.0.2", names=("ana.local",)) as server:
        for host, status in (
            ("ana.local", 200),
            ("Ana.Local", 200),
            ("luis.local", 403),
            ("ana.local.", 403),
        ):
            answer = await request(server, "GET / HTTP/1.1", host=f"{host}:{server.port}")
            assert answer[0] == status, host
        origin = f"http://ana.local:{server.port}"
        async with line_to(server, origin=origin) as line:
            await line.send(json.dumps({"type": "hello", "token": server.guard.tokens[Role.VIEW]}))
            assert json.loads(await line.recv())["role"] == "view"


async def test_ne2_a_request_with_two_host_headers_is_refused(folder):
    async with recorded_page(folder, "circle") as server:
        twice = f"GET /run/x HTTP/1.1\r\nHost: {address(server)}"
        assert (await request(server, twice))[0] == 403
        assert (await request(server, "GET /run/x HTTP/1.1", host=f"LocalHost:{server.port}"))[0] == 404


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:1", "https://127.0.0.1:{port}", "file://"]
)
async def test_ne2_a_page_of_another_origin_does_not_connect(folder, origin):
    async with recorded_page(folder, "circle") as server:
        with pytest.raises(InvalidStatus, match="403"):
            async with line_to(server, origin=origin.format(port=server.port)):
                pass


async def test_ne2_a_client_without_an_origin_needs_a_token_to_watch(folder):
    async with recorded_page(folder, "circle") as server:
        async with line_to(server, origin=None) as line:
            await line.send(json.dumps({"type": "hello", "token": server.guard.tokens[Role.DRIVE]}))
            assert json.loads(await line.recv())["role"] == "view"
        async with line_to(server, origin=None) as line:
            await line.send(json.dumps({"type": "hello"}))
            assert json.loads(await line.recv())["code"] == "web.token"
            with pytest.raises(ConnectionClosed) as error_info:
                await line.recv()
            assert error_info.value.rcvd.code == 1008


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT", "get"])
async def test_ne2_http_methods_other_than_get_and_head_are_refused(folder, method):
    async with recorded_page(folder, "circle") as server:
        for path in ("/", "/ws", "/run/x"):
            status, headers, _ = await request(server, f"{method} {path} HTTP/1.1")
            assert (status, headers["Allow"]) == (405, "GET, HEAD")


async def test_ne2_a_request_with_a_body_is_refused(folder):
    async with recorded_page(folder, "circle") as server:
        for extra_headers in (
            "Content-Length: 5",
            "Transfer-Encoding: chunked",
            "X: a\r\n b: c",
            " x: y",
            "novalue",
        ):
            assert (await request(server, f"GET / HTTP/1.1\r\n{extra_headers}"))[0] == 400


async def test_ne3_shared_pages_need_a_token_and_each_token_has_its_role(folder):
    async with recorded_page(folder, "circle", shared_address="127.0.0.2") as server:
        for role, token in server.guard.tokens.items():
            async with browser(server, token=token) as visitor:
                assert visitor.hello["role"] == role.protocol_name
                assert visitor.hello["shared"]  # the page explains this risk
        async with line_to(server) as line:
            await line.send(json.dumps({"type": "hello"}))
            assert json.loads(await line.recv())["code"] == "web.token"


def test_ne4_after_five_wrong_tokens_every_token_is_refused_for_a_minute():
    now = 0.0
    guard = Guard((), 1, shared=True, now=lambda: now)
    right = guard.tokens[Role.DRIVE]
    for _ in range(MAX_FAILURES):
        assert guard.browser_role("10.0.0.1", "wrong", True) is None
    assert guard.browser_role("10.0.0.1", right, True) is None
    assert guard.browser_role("10.0.0.2", right, True) is Role.DRIVE
    now = 60.1
    assert guard.browser_role("10.0.0.1", right, True) is Role.DRIVE
    now = TOKEN_LIFETIME_S + 1.0
    assert guard.browser_role("10.0.0.2", right, True) is None


def test_ne4_every_token_is_compared_in_constant_time(monkeypatch):
    comparisons = []
    monkeypatch.setattr(guarding.hmac, "compare_digest", lambda a, b: comparisons.append(b) or a == b)
    guard = Guard((), 1, shared=True)
    for token in guard.tokens.values():
        comparisons.clear()
        assert guard.browser_role("10.0.0.1", token, True)
        assert len(comparisons) == len(Role)


def test_ne4_many_addresses_with_wrong_tokens_use_little_memory():
    guard = Guard((), 1, shared=True)
    for k in range(5000):
        guard.browser_role(f"10.0.{k // 256}.{k % 256}", "wrong", True)
    assert len(guard._failures) <= guarding.MAX_ADDRESSES + 1


@pytest.mark.usefixtures("_static")
@pytest.mark.parametrize(
    "path",
    [
        "/static/../lab/worker.py", "/static/%2e%2e/lab/worker.py", "/static/..%2flab", "/static//etc/passwd",
        "/static/secret.key", "/static/out.txt", "//etc/passwd", "/run/../circle", "/run/circle.mcap", "/run/",
        "/report/../../x", "/static/page.js%00.html", "/static\\page.js", "/static/page.js/", "/.env", "/index.html",
    ],
)  # fmt: skip
async def test_ne6_only_files_of_the_static_table_are_served(folder, path):
    async with recorded_page(folder, "circle") as server:
        assert (await request(server, f"GET {path} HTTP/1.1"))[0] == 404
        assert (await request(server, "GET /static/page.js HTTP/1.1"))[::2] == (200, b"let x")


@pytest.mark.usefixtures("_static")
@pytest.mark.parametrize(
    ("offer", "packing"), {"gzip, br": True, "br": False, "gzip;q=0": False, "": False}.items()
)
async def test_a_script_is_compressed_only_for_clients_that_accept_gzip(folder, offer, packing):
    async with recorded_page(folder, "circle") as server:
        line = "GET /static/page.js HTTP/1.1" + (f"\r\nAccept-Encoding: {offer}" if offer else "")
        status, headers, body = await request(server, line)
        assert status == 200
        assert (headers.get("Content-Encoding") == "gzip") == packing
        assert (gzip.decompress(body) if packing else body) == b"let x"


@pytest.mark.parametrize("path", ["x", "http://evil.example/", "/\0", "/a b", "*", "/\xe9"])
def test_ne6_an_invalid_path_is_refused(folder, path):
    with pytest.raises(RefusedRequest):
        parse_head(f"GET {path} HTTP/1.1\r\n\r\n".encode("latin-1"))


async def test_ne6_a_symbolic_link_in_the_folder_of_runs_is_not_served(tmp_path):
    runs = folder_of(tmp_path / "runs", circle=drive())
    secret = tmp_path / "secret.mcap"
    secret.write_bytes(b"secret")
    (runs / "link.mcap").symlink_to(secret)
    async with recorded_page(runs) as server, browser(server) as visitor:
        assert [run["name"] for run in visitor.hello["runs"]] == ["circle"]
        word = visitor.hello["runs"][0]["id"]
        assert len(word) == 24
        (runs / "circle.mcap").unlink()
        (runs / "circle.mcap").symlink_to(secret)
        assert (await request(server, f"GET /run/{word} HTTP/1.1"))[0] == 404


async def test_ne6_a_run_is_not_opened_by_name_or_path(folder):
    async with recorded_page(folder, "circle") as server, browser(server) as visitor:
        for run in ("circle", "../runs/circle.mcap", str(folder / "circle.mcap"), 3, {"a": 1}, None):
            await visitor.send("open", run=run)
            if run:
                assert (await visitor.next("refused"))["to"] == "open"


@pytest.mark.usefixtures("_static")
async def test_ne7_every_response_has_the_security_policy_headers(folder):
    async with recorded_page(folder, "circle") as server:
        for path in ("/", "/static/page.js", "/nothing", "/run/x"):
            _, headers, _ = await request(server, f"GET {path} HTTP/1.1")
            assert headers["Content-Security-Policy"].startswith(POLICY)
            assert headers["X-Content-Type-Options"] == "nosniff"
            assert headers["Referrer-Policy"] == "no-referrer"
            assert headers["X-Frame-Options"] == "DENY"
            assert headers["Cache-Control"] == "no-store"
            assert "Server" not in headers
    assert "frame-ancestors 'none'" in REPORT_POLICY
    assert "script-src" not in REPORT_POLICY


async def test_ne7_only_the_printed_addresses_contain_a_token(folder, caplog, capfd):
    async with recorded_page(folder, "circle", shared_address="127.0.0.2") as server:
        tokens = list(server.guard.tokens.values())
        async with browser(server, token=tokens[0]):
            pass
        async with line_to(server) as line:
            await line.send(json.dumps({"type": "hello", "token": tokens[1][:-1]}))
            assert json.loads(await line.recv())["code"] == "web.token"
        output = caplog.text + "".join(capfd.readouterr())
        assert not any(token[:-1] in output for token in tokens)


def test_ne8_no_file_of_the_page_refers_to_an_external_address():
    for path, asset in static_files(serving.STATIC).items():
        text = asset.content.decode("utf-8", "replace")
        addresses = set(re.findall(r"(?:https?|wss?)://[^\s\"'`<>)]+", text))
        assert {address for address in addresses if "${" not in address} <= NAMESPACES, path
        assert not AS_HTML.search(text), path


async def test_ne8_hostile_names_are_served_as_text(tmp_path):
    from dataclasses import replace

    name = "<img src=x onerror=alert(1)>"
    run = replace(drive(), vehicle_text=drive().vehicle_text.replace('name = "small"', f'name = "{name}"'))
    runs = folder_of(tmp_path / "runs", evil=run)
    async with recorded_page(runs, "evil") as server, browser(server, name=name) as visitor:
        assert visitor.hello["vehicle"]["name"] == visitor.hello["you"] == name
        answer = (await request(server, f"GET /{name.replace(' ', '')} HTTP/1.1"))[2]
        assert answer.startswith(b"404 Not Found\nNothing is at this address")
        assert b"img" not in answer


async def test_a_port_in_use_is_refused(folder):
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
        from baqueano.errors import UsageError

        with pytest.raises(UsageError, match=str(port)) as error:
            async with recorded_page(folder, port=port):
                pass
        assert error.value.diagnostic.code == "web.port-taken"


@pytest.mark.parametrize(
    ("variable", "option", "query"), [("es", "", "?lang=es"), ("en", "es", "?lang=es"), ("", "", "")]
)
def test_the_page_opens_in_the_language_of_the_command(variable, option, query, monkeypatch):
    """Before, the page of `baqueano --lang es view` opened in the language of the browser."""
    monkeypatch.setenv(LANGUAGE_VARIABLE, variable)
    monkeypatch.setattr("baqueano.messages.language._language", option)
    assert url("127.0.0.1", 8000, {}) == f"http://127.0.0.1:8000/{query}"
    assert url("127.0.0.1", 8000, {Role.VIEW: "s"}, Role.VIEW) == f"http://127.0.0.1:8000/{query}#token=s"
