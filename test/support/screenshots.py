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
"""
Pictures of pages as people see them: light, dark, on a phone, printed.

``python test/support/screenshots.py PAGE ... -o DIR`` (``make screenshots``) writes a PNG of each
section of each page in each mode, to be looked at; a PAGE is an HTML file or a directory that
contains pages.
"""

import argparse
import sys
from pathlib import Path

from browser import browser, open_page, why_no_browser

__all__ = ['MODES', 'screenshots', 'settle']

# Name -> options of `open_page`. Printed: A4 at 96 dots per inch, within margins of 15 mm.
MODES = {
    'light': {}, 'dark': {'dark': True}, 'phone': {'width': 390, 'height': 844},
    'print': {'printed': True, 'width': 680},
}
# Everything is drawn: folds are open, and charts have been asked for.
_OPEN_FOLDS = 'document.querySelectorAll("details").forEach((fold) => { fold.open = true; })'
_IS_DRAWN = """
Array.from(document.querySelectorAll('.chart:not([hidden])')).every(
  (chart) => chart.clientWidth === 0 || chart.querySelector('canvas'))
"""


def settle(page):
    """Open all folds of a page and wait until its charts are drawn."""
    page.evaluate(_OPEN_FOLDS)
    page.wait_for_function(_IS_DRAWN)


def screenshots(chromium, path, directory, modes=tuple(MODES)):
    """
    Write a picture of the head and of each section of a page in each mode.

    Parameters
    ----------
    chromium : playwright.sync_api.Browser
        The browser.
    path : Path
        The page.
    directory : Path
        Where to write; made when missing.
    modes : sequence of str
        Names in `MODES`.

    Returns
    -------
    list of Path
        The pictures.

    """
    directory.mkdir(parents=True, exist_ok=True)
    pictures = []
    for mode in modes:
        with open_page(chromium, path, **MODES[mode]) as page:
            settle(page)
            parts = page.locator('body > header, main > section')
            for number in range(parts.count()):
                part = parts.nth(number)
                name = part.get_attribute('id') or 'head'
                picture = directory / f'{path.parent.name}-{number:02d}-{name}-{mode}.png'
                part.screenshot(path=picture, animations='disabled')
                pictures.append(picture)
            if mode == 'print':
                page.pdf(path=directory / f'{path.parent.name}.pdf', prefer_css_page_size=True,
                         format='A4')
    return pictures


def main():
    """Take the pictures that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('pages', nargs='+', type=Path, metavar='PAGE')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='DIR')
    parser.add_argument('--mode', action='append', choices=MODES, help='default: all of them')
    options = parser.parse_args()
    if why_no_browser():
        print(f'screenshots: {why_no_browser()}', file=sys.stderr)
        return 1
    pages = [
        page for given in options.pages
        for page in (sorted(given.rglob('report.html')) if given.is_dir() else [given])]
    if not pages:
        print(f'screenshots: no page in {", ".join(map(str, options.pages))}', file=sys.stderr)
        return 2
    with browser() as chromium:
        for page in pages:
            for picture in screenshots(
                    chromium, page, options.output, options.mode or tuple(MODES)):
                print(picture)
    return 0


if __name__ == '__main__':
    sys.exit(main())
