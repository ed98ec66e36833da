"""The explorer in a real browser: Debian's Chromium, driven by Playwright. It is skipped where there is none."""

import http.client
import shutil
import statistics
import threading

import pytest

import softgrip_jax as sg
from softgrip_jax.units import kPa, mm

pytest.importorskip("panel", reason="Panel is missing: pip install softgrip_jax[explore]")
playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is missing: pip install softgrip_jax[test]")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
if CHROMIUM is None:
    pytest.skip("there is no Chromium: apt-get install chromium", allow_module_level=True)
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
FLAGS += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
DRAWN = "(window.softgrip || {drawn: []}).drawn.length"
MOVES = 8

pytestmark = [pytest.mark.filterwarnings("ignore"), pytest.mark.slow]


@pytest.fixture(scope="module")
def address():
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    served = sg.explore(sg.shell.FlatContact(shell, distance=5 * mm), 15 * kPa, opens=False)
    yield served.address
    served.stop()


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield opened
        opened.close()


@pytest.fixture
def page(browser, address):
    shown = browser.new_page(viewport={"width": 1280, "height": 1000})
    outside = []
    shown.on("request", lambda r: outside.append(r.url) if not r.url.startswith((address, "data:", "blob:")) else None)
    shown.goto(address)
    shown.wait_for_selector(".bk-Figure canvas", timeout=60_000)
    shown.get_by_text("kPa; nearest").or_(shown.get_by_text("15 kPa", exact=False)).first.wait_for(timeout=60_000)
    yield shown
    shown.close()
    assert outside == []


def box(page, k):
    return page.locator("input[type=text]").nth(k)


def test_a_slider_by_keyboard_redraws(page):
    """Times by the browser's own clock are printed; the slowest machine has to answer within two seconds."""
    page.evaluate("document.addEventListener('keydown', () => { window.begun = performance.now(); }, true)")
    handle, times = page.locator(".noUi-handle").nth(0), []
    for _ in range(MOVES):
        before = page.evaluate(DRAWN)
        handle.press("ArrowLeft")
        page.wait_for_function(f"{DRAWN} > {before}", timeout=10_000)
        times.append(page.evaluate("window.softgrip.drawn.at(-1) - window.begun"))
    print(f"from key to picture: median {statistics.median(times):.0f} ms, slowest {max(times):.0f} ms")
    assert statistics.median(times) < 2000
    assert float(box(page, 0).input_value()) < 15


def test_nonsense_is_told_and_the_picture_stays(page):
    box(page, 1).fill("abc")
    box(page, 1).press("Enter")
    told = page.locator(".sg-wrong").first
    told.wait_for(timeout=10_000)
    assert "shell.a_mm is 'abc'; it must be a positive finite number in mm." in told.inner_text()
    assert page.locator(".bk-Figure canvas").count() > 0


def test_two_browsers_have_sliders_of_their_own(page, browser, address):
    other = browser.new_page()
    other.goto(address)
    other.wait_for_selector(".bk-Figure canvas", timeout=60_000)
    box(page, 1).fill("15.5")
    box(page, 1).press("Enter")
    page.wait_for_timeout(500)
    assert box(other, 1).input_value() == "16"
    other.close()


def test_it_fits_a_telephone(page):
    page.set_viewport_size({"width": 390, "height": 844})
    page.wait_for_timeout(500)
    assert page.evaluate("document.documentElement.scrollWidth") <= 400


def test_another_origin_is_refused(address):
    """A page of another site cannot open the WebSocket."""
    head = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
    head |= {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Origin": "http://elsewhere.example"}
    connection = http.client.HTTPConnection(address.split("/")[2], timeout=10)
    connection.request("GET", "/ws", headers=head)
    assert connection.getresponse().status == 403
    connection.close()


def test_a_stopped_server_is_told(browser):
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    served = sg.explore(sg.shell.FlatContact(shell, distance=5 * mm), 15 * kPa, opens=False)
    shown = browser.new_page()
    shown.goto(served.address)
    shown.wait_for_selector(".bk-Figure canvas", timeout=60_000)
    threading.Thread(target=served.stop).start()
    shown.locator("#softgrip-gone").wait_for(timeout=15_000)
    assert "The server has stopped" in shown.locator("#softgrip-gone").inner_text()
    shown.close()
