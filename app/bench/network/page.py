"""Headless Chromium on the page: `python -m app.bench.network.page SECONDS`, address on stdin."""

import json
import shutil
import sys
import time

SOFTWARE_GL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")


def main() -> None:
    """Print the updates and the drawings a second that the page counted."""
    from playwright.sync_api import sync_playwright

    seconds, address = float(sys.argv[1]), sys.stdin.readline().strip()
    path = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=SOFTWARE_GL)
        page = browser.new_page(viewport={"width": 512, "height": 512})
        page.goto(address)
        while page.evaluate("livedrive.draws") < 2:
            page.wait_for_timeout(100)
        counts = "[livedrive.updates, livedrive.draws]"
        (updates, draws), start = page.evaluate(counts), time.perf_counter()
        page.wait_for_timeout(seconds * 1000)
        after, elapsed = page.evaluate(counts), time.perf_counter() - start
        rates = [(b - a) / elapsed for a, b in zip((updates, draws), after, strict=True)]
        print(json.dumps({"page_updates_hz": rates[0], "page_draws_hz": rates[1]}))
        browser.close()


if __name__ == "__main__":
    main()
