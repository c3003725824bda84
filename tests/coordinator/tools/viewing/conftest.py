"""Pages in a browser: headless Chromium, driven by Playwright."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from processes.watched_pages import Open

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """Start the browser that Debian has."""
    from playwright.sync_api import sync_playwright

    path = shutil.which("chromium")
    assert path is not None, "no chromium: apt-get install chromium"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        yield browser
        browser.close()


@pytest.fixture
def opened(chromium: Any) -> Iterator[Open]:
    """Open pages, paused at the start; fail if one complains, or asks for anything."""
    said: list[str] = []
    contexts: list[Any] = []

    def open_page(path: Path, *, scheme: str = "light", playing: bool = False) -> Any:
        context = chromium.new_context(viewport={"width": 1280, "height": 800}, color_scheme=scheme)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: said.append(f"console: {message.text}"))
        page.on("pageerror", lambda error: said.append(f"error: {error}"))

        def asked(request: Any) -> None:
            if request.url not in {path.as_uri(), "data:,"}:
                said.append(f"asks for {request.url}")

        page.on("request", asked)
        page.goto(path.as_uri())
        page.wait_for_selector("html[data-ready]")
        if not playing:
            page.evaluate("cubepath.seek(0)")
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert said == []
