"""Open a report in a headless browser and take a picture of it: docs/img/report.png.

    microslip run jobs/fan_small.toml && microslip report results/fan_small/results.h5
    python jobs/docs/report_picture.py results/fan_small/report.html docs/img/report.png [--width 1280] [--height 1500]

Needs chromium (Debian: chromium) or a browser of its family; no screen and no graphics card. Exit status 1 if the page logs an
error, requests anything from the network, or is blank.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from matplotlib.image import imread

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge")
SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")  # WebGL without a graphics card
NOWHERE = "--proxy-server=http://127.0.0.1:9"  # a proxy that does not exist: network requests fail with an error
LEAST_SPREAD = 0.05  # of the brightness, 0 to 1, of a page that is not blank
FAULT = re.compile(r"CONSOLE.*(?:Uncaught|Refused|Failed to load|ERR_|WebGL.*(?:not|fail)).*", re.IGNORECASE)


def opened(page: Path, picture: Path, width: int, height: int) -> list[str]:
    """Draw a page in a window of a size [pixels]; return the errors that the browser logs."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        sys.exit(f"none of {', '.join(BROWSERS)} is here (Debian: apt-get install chromium)")
    with tempfile.TemporaryDirectory() as profile:
        command = [browser, "--headless=new", "--no-sandbox", *SOFTWARE, NOWHERE, "--hide-scrollbars", "--enable-logging=stderr"]
        command += [f"--user-data-dir={profile}", f"--window-size={width},{height}", f"--screenshot={picture.resolve()}"]
        done = subprocess.run([*command, page.resolve().as_uri()], capture_output=True, text=True, timeout=600)
    problems = FAULT.findall(done.stderr)
    return problems if picture.is_file() else [*problems, f"no picture was made: {done.stderr[-300:]}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("page", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--width", type=int, default=1280)
    parser.add_argument("--height", type=int, default=1500)
    arguments = parser.parse_args()
    arguments.picture.unlink(missing_ok=True)
    faults = opened(arguments.page, arguments.picture, arguments.width, arguments.height)
    if not faults and imread(arguments.picture)[..., :3].std() < LEAST_SPREAD:
        faults = ["the picture is blank"]
    if faults:
        sys.exit("\n".join(faults))
    print(f"{arguments.picture}: {arguments.page} at {arguments.width} pixels, no errors")


if __name__ == "__main__":
    main()
