"""The pictures of docs/guides/explore.md, with Chromium and softgrip_jax[explore]."""

import re
import shutil
from pathlib import Path

from playwright.sync_api import sync_playwright

import softgrip_jax as sg
from softgrip_jax.commands import programs
from softgrip_jax.units import kPa

IMAGES = Path(__file__).parent / "images"
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
FLAGS += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]


def search(page):
    """The tab of a search under way, from its boxes to its pictures."""
    tab = page.locator(".bk-tab", has_text="Search from here")
    tab.click()
    for key in ("finger.a_mm", "finger.t_m_mm", "finger.H_mm"):
        page.locator(f"label:has-text('{key}') input[type=checkbox]:visible").check()
    page.get_by_role("button", name="run", exact=True).click()
    page.get_by_text(re.compile(r"step [1-3]\d of 100: best")).wait_for(timeout=300_000)
    top = tab.bounding_box()["y"] + page.evaluate("window.scrollY")
    clip = {"x": 0, "y": top, "width": 1280, "height": 760}
    page.screenshot(path=IMAGES / "explorer-search.png", full_page=True, clip=clip)
    page.get_by_role("button", name="stop", exact=True).click()
    page.get_by_role("button", name="run", exact=True).and_(page.locator(":enabled")).wait_for(timeout=120_000)


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
        search(page)
        browser.close()
    served.stop()


if __name__ == "__main__":
    main()
