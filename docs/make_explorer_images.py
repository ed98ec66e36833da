"""The pictures of docs/guides/explore.md, with Chromium and softgrip_jax[explore]."""

import shutil
import statistics
from pathlib import Path

from playwright.sync_api import sync_playwright

import softgrip_jax as sg
from softgrip_jax.commands import programs
from softgrip_jax.units import kPa

IMAGES = Path(__file__).parent / "images"
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
FLAGS += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
MOVES = 40


def latencies(page, moves=MOVES):
    """ms from a key on the slider of the pressure to the new picture, by the browser's own clock."""
    page.evaluate("document.addEventListener('keydown', () => { window.begun = performance.now(); }, true)")
    handle, times, drawn = page.locator(".noUi-handle").first, [], "(window.softgrip || {drawn: []}).drawn.length"
    for _ in range(moves):
        before = page.evaluate(drawn)
        handle.press("ArrowLeft")
        page.wait_for_function(f"{drawn} > {before}", timeout=20_000)
        times.append(page.evaluate("window.softgrip.drawn.at(-1) - window.begun"))
        page.wait_for_timeout(150)
    return sorted(times)


def main():
    programs.settings()  # programs are kept and compiled as by the command
    scene = sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"))
    served = sg.explore(scene, 30 * kPa, opens=False)
    with sync_playwright() as driver:
        path = shutil.which("chromium") or shutil.which("chromium-browser")
        browser = driver.chromium.launch(executable_path=path, args=FLAGS)
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.goto(served.address)
        page.wait_for_selector(".bk-Figure canvas", timeout=120_000)
        page.wait_for_timeout(12_000)
        page.screenshot(path=IMAGES / "explorer.png")
        times = latencies(page)
        print(f"median {statistics.median(times):.0f} ms, slowest of {len(times)}: {times[-1]:.0f} ms")
        browser.close()
    served.stop()


if __name__ == "__main__":
    main()
