"""Debian's chromium, driven by selenium, with WebGL in software."""

import contextlib
import os
import shutil
import signal

import pytest
from selenium import webdriver
from selenium.common.exceptions import WebDriverException
from selenium.webdriver.chrome.service import Service
from urllib3.exceptions import HTTPError

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
FLAGS = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1000,900")
LONGEST = 90  # seconds for a page to load
# Of a machine without a screen or a graphics card: WebGL is drawn by SwiftShader.
SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
needs_chromium = pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="chromium and chromium-driver are not installed")


@contextlib.contextmanager
def chromium(*flags):
    """A browser that keeps its messages; ``get_log("browser")`` has them."""
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for flag in (*FLAGS, *flags):
        options.add_argument(flag)
    driver = webdriver.Chrome(options, Service(DRIVER, popen_kw={"start_new_session": True}))
    driver.set_page_load_timeout(LONGEST)
    group = driver.service.process.pid
    try:
        yield driver
    finally:
        with contextlib.suppress(WebDriverException, HTTPError):  # of a page that hangs
            driver.quit()
        with contextlib.suppress(ProcessLookupError):  # then the browser outlives its driver
            os.killpg(group, signal.SIGKILL)


def pose(page, body=0):
    """Where a view shows a body."""
    return page.execute_script("return jaxball.pose(arguments[0])", body)
