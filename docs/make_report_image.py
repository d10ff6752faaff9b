"""Make the picture of a report in the pages here: chromium shows the report of a study of the reference case.

PYTHONPATH=. python docs/make_report_image.py RESULTS_DIR
"""

import sys
from pathlib import Path

from tests.browser import Browser

IMAGES = Path(__file__).parent / "images"


def main():
    address = (Path(sys.argv[1]).resolve() / "report.html").as_uri()
    with Browser() as browser:
        browser.open(address, 1400, 1000)
        browser.screenshot(IMAGES / "report.png", whole=False)
        browser.evaluate("document.getElementById('motion').scrollIntoView({behavior: 'instant'})")
        browser.evaluate("document.getElementById('which').value = 'lateral rate'")
        browser.evaluate("document.getElementById('which').dispatchEvent(new Event('change'))")
        browser.evaluate(
            "(time => { time.value = 850; time.dispatchEvent(new Event('input')); })(document.getElementById('time'))"
        )
        browser.screenshot(IMAGES / "report_motion.png", whole=False)


if __name__ == "__main__":
    main()
