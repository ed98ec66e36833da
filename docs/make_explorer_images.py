"""The pictures of docs/guides/explore.md, with Chromium and softgrip_jax[explore]."""

import shutil
from pathlib import Path

from playwright.sync_api import sync_playwright

import softgrip_jax as sg
from softgrip_jax.commands import programs
from softgrip_jax.units import kPa

IMAGES = Path(__file__).parent / "images"
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
FLAGS += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]


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
        page.wait_for_timeout(60_000)  # until the curve and the bars are compiled, too
        page.screenshot(path=IMAGES / "explorer.png")
        browser.close()
    served.stop()


if __name__ == "__main__":
    main()
