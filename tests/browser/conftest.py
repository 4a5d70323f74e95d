"""A real Chromium before a real server: the tests of this folder are skipped where there is none."""

import contextlib
import os
import shutil
import socket
import sys
import threading
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

_HERE = Path(__file__).parent
sys.path[:0] = [str(_HERE), str(_HERE.parent / "process")]
from processes import Processes, free_port  # noqa: E402

FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    # The browser's own errands (updates, accounts) go to a port of this machine at which nobody listens.
    *(
        f"--{which}=http://127.0.0.1:9/"
        for which in ("google-apis-url", "gaia-url", "apps-gallery-update-url")
    ),
    "--component-updater=url-source=http://127.0.0.1:9/",
    "--disable-features=AutofillServerCommunication,OptimizationHints,OptimizationGuideModelDownloading,"
    "OptimizationGuideOnDeviceModel,NetworkTimeServiceQuerying,MediaRouter,Translate",
]
TIMEOUT_S = 300


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A browser on a busy machine takes its time; most of what it does is for `make browser-test`."""
    for item in items:
        if item.path.parent != _HERE:
            continue
        item.add_marker(pytest.mark.timeout(TIMEOUT_S))
        if item.get_closest_marker("short") is None and not os.environ.get("HALOCLINE_BROWSER"):
            item.add_marker(
                pytest.mark.skip(reason="the long form: make browser-test, or HALOCLINE_BROWSER=1")
            )


def find() -> str | None:
    """The browser's path, None if there is none."""
    return os.environ.get("HALOCLINE_CHROMIUM") or shutil.which("chromium")


@pytest.fixture(scope="session")
def chromium_path() -> str:
    """Where the browser is."""
    found = find()
    if found is None:
        pytest.skip("no chromium: make browser-test installs it, or name one in HALOCLINE_CHROMIUM")
    return found


class OutsideWitness:
    """A proxy that lets nothing through: whoever is sent to it wanted something that is not on this machine.

    Chromium asks its proxy for everything but loopback addresses.
    """

    def __init__(self) -> None:
        self.asked: list[str] = []
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self._socket.getsockname()[1]}"
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self._socket.accept()
                with connection, contextlib.suppress(OSError):
                    connection.settimeout(1.0)
                    self.asked.append(connection.recv(200).decode("latin-1").split("\r\n")[0])

    def close(self) -> None:
        """Listen no more."""
        self._socket.close()


@pytest.fixture(scope="module")
def outside() -> Iterator[OutsideWitness]:
    """What the browser has wanted from elsewhere."""
    witness = OutsideWitness()
    yield witness
    witness.close()


@pytest.fixture(scope="module")
def browser(chromium_path: str, outside: OutsideWitness) -> Iterator["object"]:
    """One browser for a module's tests, each with a context (cookies, storage) of its own.

    While it is open an event loop runs in this thread: tests elsewhere must find none.
    """
    api = pytest.importorskip("playwright.sync_api", reason="needs playwright: pip install 'halocline[dev]'")
    with api.sync_playwright() as playwright:
        flags = [*FLAGS, f"--proxy-server={outside.address}"]
        opened = playwright.chromium.launch(executable_path=chromium_path, args=flags)
        yield opened
        opened.close()


class Station:
    """`autonomy shore serve` as a process; `endpoint` is where vessels find it, `url` where browsers do."""

    def __init__(self, processes: Processes) -> None:
        self._processes = processes
        self.port = free_port()
        self.endpoint = f"tcp/127.0.0.1:{self.port}"
        self.http = f"127.0.0.1:{free_port()}"
        self.url = f"http://{self.http}/"
        self.start()

    def start(self) -> None:
        """Start it, and wait until it answers."""
        words = ("-m", "autonomy", "shore", "serve", "--listen", self.endpoint, "--http", self.http)
        self.process = self._processes.start(*words)
        self.process.wait_until(self._answers, what="the page's first answer")

    def _answers(self) -> bool:
        with contextlib.suppress(OSError), urllib.request.urlopen(self.url, timeout=5.0) as answer:
            return bool(answer.status == 200)
        return False


@pytest.fixture(scope="module")
def station() -> Iterator[Station]:
    """A server for the tests of a module."""
    with Processes() as processes:
        yield Station(processes)


class Visit:
    """A page that somebody has opened, and what it complained of and asked for."""

    def __init__(self, context: "object", url: str) -> None:
        self.page = context.new_page()
        self.complaints: list[str] = []
        self.addresses: set[str] = set()
        self.page.on("console", self._on_console)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.addresses.add(request.url))
        self.page.on("websocket", lambda opened: self.addresses.add(opened.url))
        self.page.goto(url)

    def _on_console(self, message: "object") -> None:
        if message.type in ("error", "warning"):
            self.complaints.append(f"{message.text} {message.location.get('url', '')}")

    def wait_for_maps(self, count: int = 2, moment: str = "now") -> None:
        """Until so many maps of a moment are drawn."""
        drawn = self.page.locator(f'.map-canvas[data-drawn="{moment}"]')
        drawn.nth(count - 1).wait_for(state="attached", timeout=60_000)

    def pixels(self, vehicle: str, quantity: str = "mean") -> str:
        """The picture on a map's canvas."""
        selector = f'.panel[data-vehicle="{vehicle}"] .surface[data-quantity="{quantity}"] canvas'
        return self.page.evaluate("selector => document.querySelector(selector).toDataURL()", selector)


@pytest.fixture
def visit(browser: "object", station: Station) -> Iterator[Callable[..., Visit]]:
    """Opens the page, `visit(fragment, width=…, scheme=…)`; at the end nobody may have complained."""
    visits: list[Visit] = []
    with contextlib.ExitStack() as stack:

        def opened(
            fragment: str = "",
            width: int = 1440,
            height: int = 900,
            scheme: str = "light",
            touch: bool = False,
        ) -> Visit:
            context = browser.new_context(
                viewport={"width": width, "height": height}, color_scheme=scheme, has_touch=touch
            )
            stack.callback(context.close)
            visits.append(Visit(context, station.url + fragment))
            return visits[-1]

        yield opened
        assert [each.complaints for each in visits] == [[] for _ in visits]
