"""The page in a browser: it loads without an error, asks nobody else for anything, and moves with its sliders."""

import contextlib
import itertools
import json
import re
import shutil
import subprocess
import time
import urllib.request

import numpy as np
import pytest

import bodyimage_kin as bk
from bodyimage_kin import view

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
viser = pytest.importorskip("viser", reason="viser is not installed: no page is served")
in_browser = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed: the page is not opened")

# Clicks whatever a label stands beside.
CLICK = "[...document.querySelectorAll('label')].find(one => one.textContent === '{}').click()"


@pytest.fixture(scope="module")
def scene(body, circle, touch):
    estimators = {"least_squares": bk.estimators.LeastSquares()}
    ghosts = body.touch_postures([0, 440]).numpy()
    return view.Scene(body, {"touch": touch, "circle": circle}, estimators, learn_from=circle, ghosts=ghosts)


@pytest.fixture
def page(scene):
    page = view.serve(scene, 0)
    yield page
    page.stop()


class Browser:
    """A tab of a headless Chromium, driven over its own protocol."""

    def __init__(self, folder):
        command = [
            CHROMIUM, "--headless", "--no-sandbox", "--disable-background-networking", "--disable-component-update",
            "--no-first-run", "--disable-sync", "--disable-default-apps", "--use-gl=angle", "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
            "--remote-debugging-port=0", f"--user-data-dir={folder / 'profile'}", "--window-size=800,600",
            "about:blank",
        ]  # fmt: skip
        self.process = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        told = folder / "profile" / "DevToolsActivePort"
        self.wait(lambda: told.exists() and len(told.read_text().split()) == 2)
        port = told.read_text().split()[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
            tab = next(one for one in json.load(answer) if one["type"] == "page")
        from websockets.sync.client import connect

        self.socket = connect(tab["webSocketDebuggerUrl"], max_size=None)
        self.numbers, self.events = itertools.count(1), []
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method, **parameters):
        number = next(self.numbers)
        self.socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self.socket.recv(timeout=120))
            if answer.get("id") == number:
                return answer["result"]
            self.events.append(answer)

    def evaluate(self, expression):
        return self.call("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def picture(self):
        return self.call("Page.captureScreenshot", format="png")["data"]

    @staticmethod
    def wait(done, seconds=90):
        end = time.monotonic() + seconds
        while not done():
            assert time.monotonic() < end, "nothing came"
            time.sleep(0.2)

    def asked(self):
        return {one["params"]["request"]["url"] for one in self.events if one["method"] == "Network.requestWillBeSent"}

    def complaints(self):
        """Errors of the page; that the drawing is done without a graphics card is none."""
        found = [one["params"] for one in self.events if one["method"] in ("Runtime.exceptionThrown", "Log.entryAdded")]
        said = [json.dumps(one) for one in found if one.get("entry", {}).get("level") in (None, "error")]
        said += [
            json.dumps(one["params"]["args"])
            for one in self.events
            if one["method"] == "Runtime.consoleAPICalled" and one["params"]["type"] == "error"
        ]
        return [text for text in said if not re.search(r"GPU stall|favicon|swiftshader", text, re.IGNORECASE)]

    def close(self):
        self.socket.close()
        self.process.terminate()
        self.process.wait(30)


@pytest.fixture
def browser(tmp_path):
    browser = Browser(tmp_path)
    with contextlib.closing(browser):
        yield browser


def test_the_page_is_served_to_this_machine_alone(page):
    assert page.address.startswith("http://127.0.0.1:")
    listening = page.server._websock_server
    assert listening._host == "127.0.0.1"
    assert page.server.request_share_url() is None


def test_a_page_says_nothing_by_itself(scene, capsys):
    view.serve(scene, 0).stop()
    said = capsys.readouterr()
    assert said.out == said.err == ""


def test_sliders_and_selectors_move_what_is_shown(page, scene):
    last = int(page.time.max)
    before = np.array(page._drawing.hands["hand"].position)
    page.time.value = last // 2
    page.show()
    moment = scene.moment("touch", last // 2)
    np.testing.assert_allclose(page._drawing.hands["hand"].position, moment.hand)
    assert np.abs(before - moment.hand).max() > 1e-3
    assert not page._drawing.hands["estimated_hand"].visible
    page.estimator.value = "least_squares"
    page.show()
    assert page._drawing.hands["estimated_hand"].visible
    np.testing.assert_allclose([slider.value for slider in page.joints], moment.q, atol=1e-6)
    page.ghosts.value = False
    page.show()
    assert not page._drawing.ghosts.visible
    page.joints[0].value = float(page.joints[0].min)
    page._moved()
    assert page.recording.value == "a posture"
    assert not page.time.visible


@in_browser
def test_the_page_loads_and_moves_without_an_error(page, browser):
    browser.call("Page.navigate", url=page.address)
    browser.wait(lambda: browser.evaluate("!!document.querySelector('canvas')"))
    browser.wait(lambda: "estimator" in (browser.evaluate("document.body.innerText") or ""))
    time.sleep(3)
    first = browser.picture()
    page.estimator.value = "least_squares"
    page.time.value = int(page.time.max) // 2
    page.show()
    browser.wait(lambda: browser.picture() != first)
    browser.wait(lambda: f"sample {int(page.time.max) // 2}" in browser.evaluate("document.body.innerText"))
    # The postures to go to next are there until somebody takes them away.
    assert page._drawing.ghosts.visible
    with_ghosts = browser.picture()
    browser.evaluate(CLICK.format("next postures"))
    browser.wait(lambda: not page.ghosts.value)
    browser.wait(lambda: browser.picture() != with_ghosts)
    assert not page._drawing.ghosts.visible
    assert not browser.complaints()
    assert {url for url in browser.asked() if not re.match(r"data:|blob:|http://127\.0\.0\.1:", url)} == set()


@in_browser
def test_an_exported_scene_stands_alone(scene, browser, tmp_path):
    path = view.export(scene, tmp_path / "scene.html", "touch", "least_squares", frames=5)
    assert path.stat().st_size < 4e6
    browser.call("Page.navigate", url=path.as_uri())
    browser.wait(lambda: browser.evaluate("!!document.querySelector('canvas')"))
    time.sleep(3)
    browser.picture()
    assert not browser.complaints()
    assert {url for url in browser.asked() if not re.match(r"data:|blob:|file:", url)} == set()
