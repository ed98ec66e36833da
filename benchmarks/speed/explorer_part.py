"""What the hand on a slider waits for: from a key to the drawn picture, by the browser's own clock.

`softgrip explore` runs as a user starts it, in a process of its own; Chromium without a display, driven by Playwright,
is its browser, on the same machine. A picture counts as drawn at the first moment after the frame in which it changed.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent.parent
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
FLAGS += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
CONFIGS = {"shell": "shell_flat", "finger, tip held": "finger_tip_contact", "energy membrane": "shell_plane_energy"}
KEYS, APART_MS = 150, (30, 400)
"""Keys that are waited for, and the time from a picture to the next key, at random: as a hand does."""
FAST, GAP_MS = 40, 60
"""Keys in a row that are not waited for, and the time between them."""
FIELDS = ("scene", "first_view_s", "second_view_s", "keys", "median_ms", "of_100_99_ms", "slowest_ms", "fast_keys",
          "fast_drawn", "last_drawn")  # fmt: skip
DRAWN = "(window.softgrip || {drawn: []}).drawn.length"
HELPED = """Bokeh.documents.some(document => [...document._all_models.values()].some(
  model => model.data && model.data.key && model.data.key.length))"""
"""Whether the bars are there, the last that is compiled. What runs for long is then compiled once more, to run
faster."""
BEGUN = "document.addEventListener('keydown', () => { window.begun = performance.now(); }, true)"


@contextmanager
def served(config: str, cache: str) -> Iterator[str]:
    """The address of an explorer that has just been started."""
    order = [sys.executable, "-c", "from softgrip_jax.cli import main; main()", "explore", f"configs/{config}.toml"]
    environment = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS", "JAX_COMPILATION_CACHE_DIR")}
    process = subprocess.Popen(
        [*order, "--no-open"], cwd=ROOT, env=environment | {"XDG_CACHE_HOME": cache}, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        for line in process.stdout:
            words = [word for word in line.split() if word.startswith("http://")]
            if words:
                yield words[0].rstrip(".,;")
                return
        raise RuntimeError(f"softgrip explore ended with {process.wait()}")
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(30)


def first_view(browser: Any, config: str, cache: str) -> float:
    """Seconds from the command to the first picture in a browser that is open."""
    began = time.perf_counter()
    with served(config, cache) as address:
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.goto(address)
        page.locator(".sg-told", has_text="kPa").first.wait_for(timeout=120_000)
        took = time.perf_counter() - began
        page.close()
    return took


def keys(page: Any, count: int) -> tuple[np.ndarray, int, bool]:
    """(ms from each key to its picture, pictures of FAST keys in a row, whether the last of them was drawn)."""
    page.evaluate(BEGUN)
    handles = page.locator(".noUi-handle")
    times = []
    for k, apart in enumerate(np.random.default_rng(0).uniform(*APART_MS, count)):
        before = page.evaluate(DRAWN)
        # The pressure and the first dimension in turn, to and fro: no rule is broken on the way.
        handles.nth(k % 2).press("ArrowLeft" if k // 2 % 20 < 10 else "ArrowRight")
        page.wait_for_function(f"{DRAWN} > {before}", timeout=10_000, polling=5)
        times.append(page.evaluate("window.softgrip.drawn.at(-1) - window.begun"))
        page.wait_for_timeout(apart)
    page.wait_for_timeout(2000)
    before = page.evaluate(DRAWN)
    for _ in range(FAST):
        handles.nth(0).press("ArrowLeft")
        page.wait_for_timeout(GAP_MS)
    page.wait_for_timeout(1000)
    drawn = page.evaluate(DRAWN) - before
    return np.array(times), drawn, bool(page.evaluate("window.softgrip.drawn.at(-1) > window.begun"))


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """A row for each kind of scene; nothing where there is no Chromium or no Playwright."""
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    try:
        from playwright.sync_api import sync_playwright
    except ModuleNotFoundError:
        return
    if path is None:
        return
    os.sched_setaffinity(0, range(os.cpu_count() or 1))  # what a user has
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=FLAGS)
        for scene, config in list(CONFIGS.items())[: 1 if quick else None]:
            cache = tempfile.mkdtemp(prefix="softgrip-bench-")
            try:
                views = [first_view(browser, config, cache) for _ in range(2)]
                with served(config, cache) as address:
                    page = browser.new_page(viewport={"width": 1280, "height": 900})
                    page.goto(address)
                    page.locator(".sg-told", has_text="kPa").first.wait_for(timeout=120_000)
                    page.wait_for_function(HELPED, timeout=300_000)
                    page.wait_for_timeout(1_000 if quick else 60_000)
                    times, drawn, last = keys(page, 10 if quick else KEYS)
                    page.close()
            finally:
                shutil.rmtree(cache)
            numbers = (*views, len(times), np.median(times), np.quantile(times, 0.99), times.max(), FAST, drawn)
            yield dict(zip(FIELDS, (scene, *numbers, "yes" if last else "no"), strict=True))
        browser.close()
