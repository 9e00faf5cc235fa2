"""Debian's Chromium, controlled by its own protocol over one WebSocket: open a page, press keys, wait, read the
page.
"""

import base64
import json
import shutil
import subprocess
import tempfile
import time
import urllib.error
import urllib.request
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

SIZES = {"phone": (390, 844), "tablet": (1024, 768), "laptop": (1280, 800), "projector": (1920, 1080)}
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run", "--mute-audio",
    "--disable-background-networking", "--disable-component-update", "--disable-extensions", "--disable-sync",
    "--disable-dev-shm-usage", "--remote-debugging-port=0", "--remote-allow-origins=*",
)  # fmt: skip
WAIT_S = 15.0
FRAME_MS = 50  # without a graphics card each frame costs processor time, so pages draw 20 frames per second
FEW_FRAMES = f"""{{
  const frame = requestAnimationFrame.bind(globalThis);
  globalThis.requestAnimationFrame = (draw) => setTimeout(() => frame(draw), {FRAME_MS});
}}"""


class Chromium:
    """A browser without a window; `with Chromium() as browser: tab = browser.tab()`."""

    def __enter__(self) -> "Chromium":
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self._process = subprocess.Popen(
            [str(CHROMIUM), *FLAGS, f"--user-data-dir={self._folder.name}", "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        port_file = Path(self._folder.name, "DevToolsActivePort")
        end_s = time.monotonic() + 60.0
        while not (port_file.exists() and port_file.read_text().count("\n")):
            assert time.monotonic() < end_s, "Chromium did not start"
            time.sleep(0.05)
        self.port = int(port_file.read_text().splitlines()[0])
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait(20)
        self._folder.cleanup()

    def tab(self) -> "Tab":
        new = urllib.request.Request(f"http://127.0.0.1:{self.port}/json/new?about:blank", method="PUT")
        with urllib.request.urlopen(new) as answer:
            return Tab(json.load(answer)["webSocketDebuggerUrl"])

    def window(self) -> "Tab":
        """Return the tab of a new window, which is drawn beside the other tabs."""
        with connect(self._browser_url()) as line:
            create = {"method": "Target.createTarget", "params": {"url": "about:blank", "newWindow": True}}
            line.send(json.dumps({"id": 1, **create}))
            while (word := json.loads(line.recv(60))).get("id") != 1:
                pass
        return Tab(f"ws://127.0.0.1:{self.port}/devtools/page/{word['result']['targetId']}")

    def close_tabs(self) -> None:
        """Close the pages that tests left open, because each page draws as long as it is open."""
        address = f"http://127.0.0.1:{self.port}/json"
        with urllib.request.urlopen(f"{address}/list") as answer:
            pages = [page for page in json.load(answer) if page["type"] == "page"]
        for page in pages:
            with suppress(urllib.error.HTTPError):  # the page has just closed
                if page["url"] != "about:blank":  # without its first page the browser would end
                    urllib.request.urlopen(f"{address}/close/{page['id']}").close()

    def _browser_url(self) -> str:
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/json/version") as answer:
            return json.load(answer)["webSocketDebuggerUrl"]


class Tab:
    """A page of the browser. `errors` lists its failures: exceptions and refused sources."""

    def __init__(self, url: str) -> None:
        self._open = ExitStack()
        self._socket = self._open.enter_context(connect(url, max_size=None))
        self._request_id = 0
        self.errors: list[str] = []
        for domain in ("Page", "Runtime", "Log"):
            self.do(f"{domain}.enable")
        self.do("Page.addScriptToEvaluateOnNewDocument", source=FEW_FRAMES)

    def close(self) -> None:
        self.do("Page.close")
        self._open.close()

    def do(self, method: str, **parameters: object) -> Any:
        self._request_id += 1
        self._socket.send(json.dumps({"id": self._request_id, "method": method, "params": parameters}))
        while True:
            word = json.loads(self._socket.recv(60))
            if word.get("id") == self._request_id:
                assert "error" not in word, f"{method}: {word['error']}"
                return word["result"]
            if word.get("method") == "Runtime.exceptionThrown":
                exception = word["params"]["exceptionDetails"]
                self.errors.append(exception.get("exception", {}).get("description", exception["text"]))
            if word.get("method") == "Log.entryAdded" and word["params"]["entry"]["level"] == "error":
                self.errors.append(word["params"]["entry"]["text"])

    def goto(self, url: str) -> None:
        self.do("Page.navigate", url=url)
        self.wait(f"location.href.startsWith({url.split('#')[0]!r}) && document.readyState === 'complete'")

    def size(self, width: int, height: int, scale: float = 1.0) -> None:
        touch = width < 600
        self.do(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=scale,
            mobile=touch,
        )

    def media(self, **features: str) -> None:
        """Emulate media features, as `prefers_color_scheme="dark"`."""
        media = [{"name": name.replace("_", "-"), "value": value} for name, value in features.items()]
        self.do("Emulation.setEmulatedMedia", features=media)

    def js(self, code: str) -> Any:
        done = self.do("Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in done, f"{code}: {done['exceptionDetails']}"
        return done["result"].get("value")

    def wait(self, code: str, seconds: float = WAIT_S) -> None:
        end_s = time.monotonic() + seconds
        while not self.js(code):
            assert time.monotonic() < end_s, f"still not true after {seconds} s: {code}"
            time.sleep(0.05)

    def press(
        self, key: str, code: str = "", text: str = "", hold_s: float = 0.0, shift: bool = False
    ) -> None:
        self.down(key, code, text, shift)
        time.sleep(hold_s)
        self.up(key, code)

    def down(self, key: str, code: str = "", text: str = "", shift: bool = False) -> None:
        text_fields = {"text": text, "unmodifiedText": text} if text else {}
        self.do("Input.dispatchKeyEvent", type="keyDown", key=key, code=code or key, modifiers=8 * shift,
                windowsVirtualKeyCode=VIRTUAL.get(code or key, 0), **text_fields)  # fmt: skip

    def up(self, key: str, code: str = "") -> None:
        self.do("Input.dispatchKeyEvent", type="keyUp", key=key, code=code or key,
                windowsVirtualKeyCode=VIRTUAL.get(code or key, 0))  # fmt: skip

    def mouse(self, kind: str, x: float, y: float) -> None:
        self.do("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def touch(self, kind: str, *fingers: tuple[float, float]) -> None:
        """Put fingers on these points ("touchStart"), move them, or lift all fingers ("touchEnd", "touchCancel")."""
        points = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(fingers)]
        self.do("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    def middle(self, selector: str) -> tuple[float, float]:
        box = self.js(
            f"(() => {{ const b = document.querySelector({selector!r}).getBoundingClientRect();"
            "return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )
        return box[0], box[1]

    def click(self, selector: str) -> None:
        self.js(
            f"document.querySelector({selector!r}).scrollIntoView({{ block: 'nearest', inline: 'nearest' }})"
        )
        x, y = self.middle(selector)
        self.mouse("mousePressed", x, y)
        self.mouse("mouseReleased", x, y)

    def shot(self, path: Path) -> None:
        path.write_bytes(base64.b64decode(self.do("Page.captureScreenshot", format="png")["data"]))


VIRTUAL = {"Space": 32, "ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, "Tab": 9, "Enter": 13,
           "Home": 36, "End": 35, "PageUp": 33, "PageDown": 34}  # fmt: skip
