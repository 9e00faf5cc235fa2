"""Implement the small part of HTTP/1.1 that the page needs: read a request head, answer it, and close the connection.

Only GET and HEAD are accepted. The path in a request is only a key of a table and is not used to build a file name.
"""

import asyncio
import gzip
import re
from http import HTTPStatus
from pathlib import Path
from typing import NamedTuple

from baqueano.diagnostics import note
from baqueano.messages import text
from baqueano.messages.language import LANGUAGES, use_language

MAX_HEAD_BYTES = 16 << 10  # bytes
MAX_HEADERS = 64
WRITE_BYTES = 64 << 10
WRITE_TIMEOUT_S = 20.0  # time limit in which a browser must accept bytes
_NAME = re.compile(r"[-!#$%&'*+.^_`|~0-9A-Za-z]+")
_PATH = re.compile(r"/[\x21-\x7e]*")
CONTENT_TYPES = {
    ".html": "text/html; charset=utf-8", ".js": "text/javascript; charset=utf-8", ".css": "text/css; charset=utf-8",
    ".json": "application/json; charset=utf-8", ".svg": "image/svg+xml", ".png": "image/png", ".ico": "image/x-icon",
    ".txt": "text/plain; charset=utf-8", ".mcap": "application/octet-stream",
}  # fmt: skip
PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
REPORT_POLICY = (  # a report contains its style and its figures, but not a script
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'; sandbox"
)
FIXED_HEADERS = {
    "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin", "Cross-Origin-Opener-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=(), usb=(), serial=()", "Cache-Control": "no-store",
    "Connection": "close",
}  # fmt: skip


class RefusedRequest(Exception):
    """The refusal of a request. The answer is an HTTP status with its phrase."""

    def __init__(self, status: HTTPStatus, **headers: str) -> None:
        super().__init__(status.phrase)
        self.status, self.headers = status, headers


class RequestHead(NamedTuple):
    """The head of a request: method, path and headers."""

    method: str
    path: str  # without the query after ?
    headers: dict[str, list[str]]  # by lower case name

    def values(self, name: str) -> list[str]:
        """Return all values of the header `name`, given in lower case; [] without this header."""
        return self.headers.get(name, [])


class Content(NamedTuple):
    """The body of an answer: bytes, or a file that is sent in chunks."""

    kind: str
    content: bytes | Path
    policy: str = PAGE_POLICY
    download: str = ""  # the file name for a download
    gzip_bytes: bytes = b""  # the same bytes compressed by gzip


async def read_head(reader: asyncio.StreamReader) -> bytes:
    """Return the bytes of a request head.

    Raise RefusedRequest if the head is too long, and EOFError if the connection ends before the end of the head.
    """
    try:
        return await reader.readuntil(b"\r\n\r\n")
    except asyncio.LimitOverrunError:
        raise RefusedRequest(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE) from None
    except asyncio.IncompleteReadError as error:
        raise EOFError from error


def parse_head(data: bytes) -> RequestHead:
    """Return the request head in these bytes. Raise RefusedRequest if it is malformed or its method is not allowed."""
    lines = data.decode("latin-1").removesuffix("\r\n\r\n").split("\r\n")
    request_line = lines[0].split(" ")
    if len(request_line) != 3 or request_line[2] not in ("HTTP/1.1", "HTTP/1.0") or len(lines) > MAX_HEADERS:
        raise RefusedRequest(HTTPStatus.BAD_REQUEST)
    headers: dict[str, list[str]] = {}
    for line in lines[1:]:
        name, colon, value = line.partition(":")
        if not colon or not _NAME.fullmatch(name) or any(c in value for c in "\r\n\0"):
            raise RefusedRequest(HTTPStatus.BAD_REQUEST)
        headers.setdefault(name.lower(), []).append(value.strip(" \t"))
    if request_line[0] not in ("GET", "HEAD"):
        raise RefusedRequest(HTTPStatus.METHOD_NOT_ALLOWED, Allow="GET, HEAD")
    if (
        not _PATH.fullmatch(request_line[1])
        or headers.get("transfer-encoding")
        or headers.get("content-length", ["0"]) != ["0"]
    ):
        raise RefusedRequest(HTTPStatus.BAD_REQUEST)
    return RequestHead(request_line[0], request_line[1].partition("?")[0], headers)


def static_files(folder: Path) -> dict[str, Content]:
    """Return URL path → content of the files in the folder, read now. Files of unknown types are omitted."""
    table = {}
    for path in sorted(folder.rglob("*")):
        kind = CONTENT_TYPES.get(path.suffix)
        if kind and path.is_file() and not path.is_symlink():
            content = path.read_bytes()
            gzip_bytes = gzip.compress(content, mtime=0) if kind.endswith("utf-8") else b""
            table[f"/static/{path.relative_to(folder).as_posix()}"] = Content(
                kind, content, gzip_bytes=gzip_bytes
            )
    if "/static/index.html" in table:
        table["/"] = table["/static/index.html"]
    return table


async def refuse(writer: asyncio.StreamWriter, reason: RefusedRequest) -> None:
    """Answer a refused request with its status code and phrase; for an unknown address add the correct address."""
    sentences = [f"{reason.status.value} {reason.status.phrase}"]
    if reason.status == HTTPStatus.NOT_FOUND:
        for language in LANGUAGES:
            with use_language(language):
                sentences.append(text(note("web.no-address")))
    kind, body = CONTENT_TYPES[".txt"], "\n".join([*sentences, ""]).encode()
    await _send(writer, _response_head(reason.status, kind, len(body), PAGE_POLICY, reason.headers) + body)


def accepts_gzip(head: RequestHead) -> bool:
    """Return True if the browser accepts gzip."""
    offers = (offer.strip().lower() for value in head.values("accept-encoding") for offer in value.split(","))
    return any(
        offer == "gzip" or (offer.startswith("gzip;") and not offer.endswith("q=0")) for offer in offers
    )


async def reply(writer: asyncio.StreamWriter, body: Content, head: RequestHead) -> None:
    """Answer a request with a body, compressed if the browser accepts this; the answer to HEAD has only headers."""
    head_only, extra_headers = head.method == "HEAD", {"Vary": "Accept-Encoding"} if body.gzip_bytes else {}
    if body.gzip_bytes and accepts_gzip(head):
        body = body._replace(content=body.gzip_bytes)
        extra_headers = extra_headers | {"Content-Encoding": "gzip"}
    is_file = isinstance(body.content, Path)
    size = body.content.stat().st_size if isinstance(body.content, Path) else len(body.content)
    if body.download:
        extra_headers["Content-Disposition"] = f'attachment; filename="{body.download}"'
    start = _response_head(HTTPStatus.OK, body.kind, size, body.policy, extra_headers)
    if head_only or not is_file:
        await _send(writer, start + (b"" if head_only or isinstance(body.content, Path) else body.content))
        return
    assert isinstance(body.content, Path)
    with body.content.open("rb") as pieces:
        await _send(writer, start)
        while size > 0 and (piece := pieces.read(min(WRITE_BYTES, size))):
            size -= len(piece)
            await _send(writer, piece)


async def _send(writer: asyncio.StreamWriter, data: bytes) -> None:
    for offset in range(0, len(data), WRITE_BYTES):
        writer.write(data[offset : offset + WRITE_BYTES])
        async with asyncio.timeout(WRITE_TIMEOUT_S):
            await writer.drain()


def _response_head(
    status: HTTPStatus, kind: str, size: int, policy: str, extra_headers: dict[str, str]
) -> bytes:
    headers = {
        "Content-Type": kind, "Content-Length": str(size), "Content-Security-Policy": policy, **FIXED_HEADERS,
        **extra_headers,
    }  # fmt: skip
    lines = [
        f"HTTP/1.1 {status.value} {status.phrase}",
        *(f"{name}: {value}" for name, value in headers.items()),
    ]
    return ("\r\n".join(lines) + "\r\n\r\n").encode("latin-1", "replace")
