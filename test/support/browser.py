# Copyright 2026 piezo_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Headless Chromium for tests of pages: as the distribution packages it, driven by Playwright."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

__all__ = ['browser', 'needs_browser', 'open_page', 'why_no_browser']

_CHROMIUM = next(filter(None, map(shutil.which, ('chromium', 'chromium-browser'))), None)

try:
    from playwright.sync_api import sync_playwright
except ImportError:
    sync_playwright = None


def why_no_browser():
    """Return what is missing for `browser`, '' if nothing is."""
    if _CHROMIUM is None:
        return 'no chromium (apt-get install chromium)'
    return '' if sync_playwright else 'no playwright (pip install playwright)'


# For tests that use `browser`.
needs_browser = pytest.mark.skipif(bool(why_no_browser()), reason=why_no_browser())


@contextmanager
def browser():
    """
    Start a headless Chromium.

    Yields
    ------
    playwright.sync_api.Browser
        The browser; it ends with the context.

    """
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=_CHROMIUM,
            # As root, in containers: no sandbox of its own, no shared memory of 64 MB.
            args=['--no-sandbox', '--disable-dev-shm-usage', '--disable-gpu'])
        try:
            yield chromium
        finally:
            chromium.close()


@contextmanager
def open_page(
    chromium, address: str | Path, *, width=1280, height=900, dark=False, printed=False,
    **options,
) -> Iterator:
    """
    Open a page, in a context of its own.

    Parameters
    ----------
    chromium : playwright.sync_api.Browser
        What `browser` yields.
    address : str or Path
        Address of the page, or a file.
    width, height : int
        Size of the window, pixels.
    dark : bool
        Whether the system prefers dark pages.
    printed : bool
        Whether to show the page as it is printed.
    **options
        Further options of ``Browser.new_context``.

    Yields
    ------
    playwright.sync_api.Page
        The page, loaded. Its attribute ``errors`` lists what its scripts raised or wrote to the
        console as errors.

    """
    context = chromium.new_context(
        viewport={'width': width, 'height': height}, color_scheme='dark' if dark else 'light',
        **options)
    # Busy machines keep a browser waiting for long.
    context.set_default_timeout(120_000)
    try:
        page = context.new_page()
        page.errors = []
        page.on('pageerror', lambda error: page.errors.append(str(error)))
        page.on('console', lambda message: (
            page.errors.append(message.text) if message.type == 'error' else None))
        if printed:
            page.emulate_media(media='print')
        page.goto(address.resolve().as_uri() if isinstance(address, Path) else address)
        yield page
    finally:
        context.close()
