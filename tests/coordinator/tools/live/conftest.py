"""Live pages in a browser."""

import shutil
from collections.abc import Iterator
from typing import Any

import pytest

from processes.watched_pages import Open

FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run")


@pytest.fixture
def opened() -> Iterator[Open]:
    """Open pages; fail if one complains, or asks another than who serves it."""
    from playwright.sync_api import sync_playwright

    said: list[str] = []
    path = shutil.which("chromium")
    assert path is not None, "no chromium: apt-get install chromium"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))

        def open_page(address: str) -> Any:
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            page.on("console", lambda message: said.append(f"console: {message.text}"))
            page.on("pageerror", lambda error: said.append(f"error: {error}"))
            own = (address, "data:", "blob:")

            def asked(request: Any) -> None:
                if not request.url.startswith(own):
                    said.append(f"asks for {request.url}")

            page.on("request", asked)
            page.goto(address)
            page.wait_for_selector("html[data-ready]")
            return page

        yield open_page
        browser.close()
    assert said == []
