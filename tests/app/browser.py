"""Headless Chromium for the page's tests: its pictures, a headset, a microphone."""

import io
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

EMULATOR = Path(".venv/node_modules/iwer/build/iwer.min.js")
SOFTWARE_GL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
MEDIA = (
    "--use-fake-ui-for-media-stream",
    "--autoplay-policy=no-user-gesture-required",
    "--disable-features=WebRtcHideLocalIpsWithMdns",  # nobody here resolves its invented names
)
# Keeps the last matrices that each uniform was given: what the page drew, as WebGL was told.
SPY = """
const set = WebGL2RenderingContext.prototype.uniformMatrix4fv;
const find = WebGL2RenderingContext.prototype.getUniformLocation;
const names = new Map();
globalThis.matrices = { modelView: [], projection: [] };
WebGL2RenderingContext.prototype.getUniformLocation = function (program, name) {
  const place = find.call(this, program, name);
  names.set(place, name);
  return place;
};
WebGL2RenderingContext.prototype.uniformMatrix4fv = function (place, flip, values) {
  const kept = matrices[names.get(place)];
  kept.push([...values]);
  if (kept.length > 2) kept.shift();
  return set.call(this, place, flip, values);
};
"""


def headset(root: Path) -> str:
    """A script that puts an emulated headset into the page."""
    if not (root / EMULATOR).exists():
        pytest.skip("the headset emulator could not be installed: make setup without npm")
    return (root / EMULATOR).read_text() + (
        ";globalThis.device = new IWER.XRDevice(IWER.metaQuest3);"
        "device.installRuntime({ forceInstall: true });"
        "device.stereoEnabled = true; device.ipd = 0.064;"
    )


@contextmanager
def chromium(**environment: str) -> Iterator[Any]:
    """A browser that lets every page hear; `environment` may name a sound server."""
    from playwright.sync_api import sync_playwright

    path = shutil.which("chromium") or shutil.which("google-chrome")
    assert path, "expected chromium, got none; run: make setup"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=path,
            args=[*SOFTWARE_GL, *MEDIA],
            env=os.environ | environment,
        )
        try:
            yield browser
        finally:
            browser.close()


def open_page(browser: Any, address: str, width: int, height: int, *scripts: str) -> Any:
    """A page that keeps its errors in `problems`."""
    page = browser.new_page(viewport={"width": width, "height": height})
    page.problems = []
    page.on("pageerror", lambda error: page.problems.append(str(error)))
    page.on("console", lambda m: page.problems.append(m.text) if m.type == "error" else None)
    for script in scripts:
        page.add_init_script(script)
    page.goto(address)
    return page


def screenshot(page: Any) -> NDArray[np.uint8]:
    """[H, W, 3]"""
    return np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))
