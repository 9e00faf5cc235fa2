"""A page in the frame of another page, in a real browser: the user cannot click an invisible control."""

import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from tests.web.chromium import CHROMIUM
from tests.web.page_client import drive, folder_of
from tests.web.test_serve import port_of, program

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="Debian's package chromium is not installed")
START_S = 60.0


@contextmanager
def stranger(in_frame):
    """Serve a page that frames `framed`, and at /plain a page that may be framed; return its address."""

    class Pages(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            source = "" if self.path == "/plain" else f'<iframe src="{in_frame or "/plain"}"></iframe>'
            self.wfile.write(f"<!doctype html><title>stranger</title><p>press here</p>{source}".encode())

        def log_message(self, *words):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Pages)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()


def framed_in(tab, address):
    """Return the final address of the frame of a page."""
    tab.goto(address)
    tree = tab.do("Page.getFrameTree")["frameTree"]
    (child,) = tree["childFrames"]
    return child["frame"].get("unreachableUrl") or child["frame"]["url"], "unreachableUrl" in child["frame"]


def test_a_framed_page_is_refused_by_a_real_browser(browser, tmp_path):
    folder = folder_of(tmp_path / "runs", circle=drive())
    with program("baqueano", "view", "circle", "--runs", str(folder), "--no-browser") as page:
        page_url, tab = f"http://127.0.0.1:{port_of(page)}/", browser.tab()
        with stranger("") as address:
            assert framed_in(tab, address) == (f"{address}plain", False)  # a permitted frame is shown
        with stranger(page_url) as address:
            assert framed_in(tab, address) == (page_url, True)
        assert any("frame-ancestors" in error for error in tab.errors), tab.errors
        tab.goto(page_url)
        tab.wait("globalThis.baqueano?.page.hello", START_S)  # without a frame the page is shown
        tab.close()
