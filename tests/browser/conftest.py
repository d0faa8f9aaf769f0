"""JupyterLab in a real browser: a server on a copy of the notebooks, Chromium, and a notebook to drive.

Every request that would leave this machine is refused, and the test that caused it fails.
"""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from playwright.sync_api import Browser, Locator, Page, Route, WebSocket, expect, sync_playwright

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
TOKEN = "browser-tests"
HERE_ONLY = re.compile(r"^(https?|wss?)://127\.0\.0\.1:")

expect.set_options(timeout=30_000)  # a busy machine is no defect

FLAGS = [  # as root and without a graphics card; quiet towards the network
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-sync",
    "--disable-quic",
    "--disable-background-networking",
    "--disable-component-update",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
]
SETTINGS = {  # no dialog comes up, nothing is asked outside
    "docmanager-extension/plugin": {"autosave": False},
    "apputils-extension/notification": {"fetchNews": "false", "checkForUpdates": False},
}

_CURRENT = "const widget = window.jupyterapp?.shell?.currentWidget, session = widget?.sessionContext;"
#: The notebook is there and its kernel answers. The status bar says idle before there is a kernel, so it is not asked.
READY = f"""name => {{ {_CURRENT}
    return widget?.context?.path === name && widget.context.isReady && session?.isReady
        && session.session?.kernel?.status === 'idle' && session.session.kernel.connectionStatus === 'connected' }}"""
#: false while cells run, then 'ok' or the list of errors that cells show.
DONE = f"""() => {{ {_CURRENT}
    const cells = widget.content.widgets.map(cell => cell.model).filter(m => m.type === 'code' && m.sharedModel.source.trim());
    const errors = cells.flatMap(m => m.sharedModel.outputs).filter(o => o.output_type === 'error');
    if (errors.length) return errors.map(o => o.ename + ': ' + o.evalue);
    return session.session?.kernel?.status === 'idle'
        && cells.every(m => m.executionCount !== null && m.executionState !== 'running') ? 'ok' : false }}"""
#: Not awaited: an evaluation in the page has no time-out. Outputs go first, else a second run looks done at once.
RUN_ALL = """() => { const commands = window.jupyterapp.commands;
    commands.execute('notebook:clear-all-cell-outputs').then(() => { commands.execute('notebook:run-all-cells') }) }"""
#: Press "Show me" on every bench that is veiled; true when all benches that cells open are there, have been told what to show,
#: which comes after their veil, and none is veiled.
LIFT = """() => {
    const cells = window.jupyterapp.shell.currentWidget.content.widgets.map(cell => cell.model).filter(m => m.type === 'code');
    const opened = cells.flatMap(m => m.sharedModel.source.match(/^explore\\(/gm) ?? []).length;
    const plots = [...document.querySelectorAll('.lab-plot')], says = (plot, css) => plot.querySelector(css).textContent !== '';
    const veils = [...document.querySelectorAll('.lab-veil:not([hidden]) .lab-lift')];
    veils.forEach(button => button.click());
    const told = plots.every(plot => says(plot, '.lab-code') || says(plot, '.lab-error-slot'));
    return plots.length >= opened && told && veils.length === 0 }"""
SHUT_DOWN = "() => { window.jupyterapp?.shell?.currentWidget?.sessionContext?.shutdown() }"
OPEN = "name => { window.jupyterapp.commands.execute('docmanager:open', { path: name, factory: 'Notebook' }) }"
#: Close every notebook and stop its kernel. Not by `close`: it asks whether to save what a cell that still runs has changed.
CLOSE_ALL = """() => {
    const ends = [...window.jupyterapp.shell.widgets('main')].map(widget => {
        const end = widget.sessionContext?.shutdown().catch(() => {});
        return Promise.resolve(end).then(() => widget.dispose());
    });
    return Promise.race([Promise.all(ends), new Promise(over => setTimeout(over, 10_000))]).then(() => ends.length);
}"""
#: What anywidget says when a page was too busy; the benches hear nevertheless (labkit.bench.heard).
IMPATIENT = "[anywidget] Failed to initialize model."
#: What the picture shows of a bar chart: where its bars are.
BARS = "figure => figure.data.filter(t => t.type === 'bar' && t.base).map(t => [Array.from(t.base), Array.from(t.x)])"
VIEWPORT = {"width": 1600, "height": 900}


class Lab(NamedTuple):
    """A running JupyterLab: its address and the folder it serves."""

    url: str
    root: Path


class Notebook:
    """An open notebook. `external` lists the requests that were refused because they would have left this machine.

    A test that has put every bench back to where it started sets `as_at_first`: the next one of this notebook may take it over.
    """

    def __init__(self, name: str, page: Page, external: list[str]) -> None:
        self.name, self.page, self.external = name, page, external
        self.as_at_first = False

    def run_all(self, timeout: float = 60_000, lift: bool = True) -> None:
        """Run all cells and wait; fails with the errors the cells show. `timeout` in ms. Benches that wait for a guess are shown
        without one if `lift` says so.
        """
        self.page.evaluate(RUN_ALL)
        outcome = self.page.wait_for_function(DONE, timeout=timeout, polling=100).json_value()
        assert outcome == "ok", outcome
        if lift:
            self.lift()

    def lift(self) -> None:
        """Show every bench without a guess."""
        self.page.wait_for_function(LIFT, timeout=60_000, polling=200)

    def cell(self, index: int) -> Locator:
        """Cell by its place in the notebook, text cells counted too, from 0."""
        return self.page.locator(".jp-NotebookPanel:not(.lm-mod-hidden) .jp-Notebook .jp-Cell").nth(index)

    def slider(self, css: str, key: str | None = None) -> Locator:
        """The handle of the slider inside `css`, focused; presses `key` on it if one is named (`ArrowRight`)."""
        handle = self.page.locator(f"{css} .noUi-handle")
        handle.focus()
        if key:
            handle.press(key)
        return handle

    def figure(self, index: int = 0) -> Locator:
        """The plotly figure of a bench by its place in the page: scrolled to, as what is out of sight is not drawn, and drawn."""
        place = self.page.locator(".lab-picture").nth(index)
        place.scroll_into_view_if_needed()
        figure = place.locator(".js-plotly-plot")
        figure.locator(".main-svg").first.wait_for()
        return figure

    def screenshot(self, name: str) -> None:
        """For the eye: save what is on the screen, once it is at rest, as NAME.png in the folder LAB_SHOTS, if that is named."""
        if "LAB_SHOTS" in os.environ:
            self.page.wait_for_timeout(900)
            self.page.screenshot(path=Path(os.environ["LAB_SHOTS"], f"{name}.png"))


def changed(nb: Notebook, figure: Locator, before: list) -> list:
    """Wait until the bars differ from `before`; returns them."""
    for _ in range(600):
        now = figure.evaluate(BARS)
        if now != before:
            return now
        nb.page.wait_for_timeout(50)
    raise AssertionError("the figure did not change within 30 s")


def chromium_path() -> str | None:
    """CHROMIUM, or the first browser of the family on the PATH."""
    named = os.environ.get("CHROMIUM")
    return named or next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(scope="package")  # Playwright keeps an event loop in this thread, in which nothing else could start one
def chromium() -> Iterator[Browser]:
    path = chromium_path()
    if path is None:
        pytest.skip("no Chromium found: install it (Debian: apt-get install chromium) or name it in CHROMIUM")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="package")
def lab(chromium: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    """JupyterLab on 127.0.0.1 with a home folder of its own, serving a copy of the notebooks."""
    home = tmp_path_factory.mktemp("lab")
    root = home / "notebooks"
    shutil.copytree(NOTEBOOKS, root, ignore=shutil.ignore_patterns(".ipynb_checkpoints"))
    for name, value in SETTINGS.items():
        file = home / "settings" / "@jupyterlab" / f"{name}.jupyterlab-settings"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(value), encoding="utf-8")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [
        sys.executable,
        "-m",
        "jupyterlab",
        "--no-browser",
        "--ip=127.0.0.1",
        f"--port={port}",
        "--ServerApp.port_retries=0",
    ]
    command += [f"--IdentityProvider.token={TOKEN}", f"--ServerApp.root_dir={root}", "--expose-app-in-browser", "--allow-root"]
    command += ["--LabApp.extension_manager=readonly"]
    command += ["--ServerApp.kernel_websocket_connection_class=labkit.server.PromptConnection"]  # as `make lab` does
    folders = {
        "JUPYTER_CONFIG_DIR": "config",
        "JUPYTER_DATA_DIR": "data",
        "JUPYTER_RUNTIME_DIR": "runtime",
        "IPYTHONDIR": "ipython",
    }
    folders |= {"JUPYTERLAB_SETTINGS_DIR": "settings", "JUPYTERLAB_WORKSPACES_DIR": "workspaces", "HOME": "."}
    environment = (
        os.environ | {"JUPYTER_WIDGETS_ECHO": "0"} | {variable: str(home / folder) for variable, folder in folders.items()}
    )
    log = home / "lab.log"
    with log.open("w") as output:
        server = subprocess.Popen(command, env=environment, stdout=output, stderr=subprocess.STDOUT, start_new_session=True)
    try:
        url = f"http://127.0.0.1:{port}"
        _wait_for(f"{url}/api/status?token={TOKEN}", server, log)
        yield Lab(url, root)
    finally:
        server.send_signal(signal.SIGTERM)  # the server stops its kernels, then itself
        try:
            server.wait(20)
        except subprocess.TimeoutExpired:
            os.killpg(server.pid, signal.SIGKILL)


def _wait_for(url: str, server: subprocess.Popen, log: Path) -> None:
    end = time.monotonic() + 60
    while True:
        try:
            urllib.request.urlopen(url, timeout=2).close()
            return
        except OSError:
            assert server.poll() is None and time.monotonic() < end, log.read_text()
            time.sleep(0.1)


@pytest.fixture(scope="package")
def lab_page(lab: Lab, chromium: Browser) -> Iterator[Callable[[str | Path], Notebook]]:
    """JupyterLab in a page, loaded once for all tests: opens a fresh copy of a notebook in place of the one before."""
    page = chromium.new_page(viewport=VIEWPORT)
    external: list[str] = []

    def refuse(route: Route) -> None:
        external.append(route.request.url)
        route.abort()

    def watch(socket: WebSocket) -> None:
        if not HERE_ONLY.match(socket.url):
            external.append(socket.url)

    def opener(notebook: str | Path) -> Notebook:
        page.evaluate(CLOSE_ALL)  # the kernels, too, else they pile up until the session ends
        shutil.copy(NOTEBOOKS / notebook, lab.root)
        page.evaluate(OPEN, Path(notebook).name)
        page.wait_for_function(READY, arg=Path(notebook).name, timeout=60_000, polling=100)
        return Notebook(Path(notebook).name, page, external)

    page.route(re.compile(r"^https?://(?!127\.0\.0\.1:)"), refuse)
    page.on("websocket", watch)
    page.goto(f"{lab.url}/lab?token={TOKEN}&reset", wait_until="domcontentloaded")
    page.wait_for_function("() => window.jupyterapp?.commands.hasCommand('docmanager:open')", timeout=60_000)
    page.wait_for_selector("#jupyterlab-splash", state="detached", timeout=60_000)
    yield opener
    page.close()


@pytest.fixture
def open_notebook(lab_page: Callable[[str | Path], Notebook], last: list[Notebook]) -> Iterator[Callable[[str | Path], Notebook]]:
    """`open_notebook("01_priority_inversion.ipynb")`, or the path of any other notebook: opens a fresh copy of it."""

    def opener(notebook: str | Path) -> Notebook:
        last[:] = [lab_page(notebook)]
        return last[0]

    yield opener
    for nb in last:
        nb.page.set_viewport_size(VIEWPORT)
        refused = nb.external.copy()
        nb.external.clear()
        assert refused == [], "the notebook asked for something outside this machine"


@pytest.fixture(scope="package")
def last() -> list[Notebook]:
    """The notebook that is open."""
    return []


@pytest.fixture
def run_notebook(open_notebook: Callable[[str | Path], Notebook], last: list[Notebook]) -> Callable[[str], Notebook]:
    """`run_notebook("05_tick_rates.ipynb")`: the notebook, run, with every bench to be seen and at its start."""

    def opener(notebook: str) -> Notebook:
        for nb in last:
            if nb.name == notebook and nb.as_at_first:
                nb.as_at_first = False
                return nb
        nb = open_notebook(notebook)
        nb.run_all(180_000)
        return nb

    return opener
