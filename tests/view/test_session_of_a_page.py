"""A session at a page: by keys alone, with the values of the file, without a connection, for other computers."""

import contextlib
import os
import shlex
import signal
import socket

import pytest
from selenium import webdriver
from selenium.webdriver import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from haptic_fieldbus.running.live import folder
from tests.running.test_live import Watcher
from tests.view.browsing import PATIENCE, STANDING, WRITTEN, Page, opened, screen, typed, until
from tests.view.served import CHROMIUM, DRIVER, children, serving

pytestmark = [
    pytest.mark.thorough("starts a browser"),
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs: apt-get install chromium chromium-driver"),
    pytest.mark.xdist_group("browser session_of_a_page"),
]


def active(browser: webdriver.Chrome) -> str:
    """Return the name of the control that has the keys."""
    return str(browser.execute_script(
        "const at = document.activeElement, named = at.closest('[aria-label]'), slider = at.closest('.q-slider');"
        "return (slider ? 'slider ' : '') + (named ? named.ariaLabel : at.id);"
    ))  # fmt: skip


def keys(browser: webdriver.Chrome, *pressed: str) -> None:
    for each in pressed:
        ActionChains(browser).send_keys(each).perform()


def tab_to(browser: webdriver.Chrome, name: str) -> None:
    """Press Tab until a control has the keys, at most once around the page."""
    for _ in range(60):
        if active(browser).startswith(name):
            return
        keys(browser, Keys.TAB)
    raise AssertionError(f"Tab does not reach {name}")


def choose(browser: webdriver.Chrome, name: str, option: str) -> None:
    """Choose an entry of a list by the arrow keys, and leave the list."""
    tab_to(browser, name)
    keys(browser, Keys.ARROW_DOWN)
    at = "document.querySelector('.q-manual-focusable--focused')?.textContent.trim()"
    until(browser, "document.querySelector('[role=option]')")
    for _ in range(80):
        if browser.execute_script(f"return {at}") == option:
            break
        keys(browser, Keys.ARROW_DOWN)
    assert browser.execute_script(f"return {at}") == option
    keys(browser, Keys.ENTER, Keys.TAB)


STIFFNESS = "haptic.state().hello.parameters[0].value"


def test_a_whole_session_by_the_keyboard_alone(browser: webdriver.Chrome) -> None:
    """Nothing is clicked; the script of the page is asked, and never told."""
    browser.set_script_timeout(PATIENCE)
    with serving("demo", "--no-browser", "--port", "0") as served:
        screen(browser, 1280, 800)
        opened(browser, served)
        until(browser, "haptic.state().steers && haptic.drawn.handle.t_ns > 0")
        # A slider: it follows the arrow while that is down, and is judged when it is released.
        tab_to(browser, "slider wall.stiffness")
        ActionChains(browser).key_down(Keys.ARROW_RIGHT).perform()
        until(browser, "/= 60\\d.* it is checked at release/.test(document.getElementById('answer').textContent)")
        assert browser.execute_script(f"return {STIFFNESS}") == 600
        ActionChains(browser).key_up(Keys.ARROW_RIGHT).perform()
        until(browser, f"{STIFFNESS} > 600 && document.getElementById('answer').className === 'made'")
        tab_to(browser, "Back to the values of the file")
        keys(browser, Keys.ENTER)
        until(browser, f"{STIFFNESS} === 600")
        # The handle, by its arrows, and let go.
        tab_to(browser, "Handle of axis")
        keys(browser, *[Keys.ARROW_RIGHT] * 12)
        until(browser, "haptic.drawn.handle.asked < -1")
        keys(browser, Keys.ENTER)
        # Pause and one period forward, on their buttons.
        tab_to(browser, "Pause or go on")
        keys(browser, Keys.ENTER)
        until(browser, "haptic.state().paused")
        before = browser.execute_async_script(STANDING)
        tab_to(browser, "One period forward")
        keys(browser, Keys.ENTER)
        until(browser, f"haptic.state().next > {before}")
        assert browser.execute_async_script(STANDING) == before + 1
        tab_to(browser, "Pause or go on")
        keys(browser, Keys.SPACE)
        until(browser, "!haptic.state().paused")
        choose(browser, "Speed", "1/4")
        until(browser, "haptic.state().speed === 0.25")
        choose(browser, "Hand", "push")
        until(browser, "haptic.drawn.handle.asked < -4")
        # Columns of a chart, held, with two cursors.
        choose(browser, "Columns of the chart error", "handle.velocity")
        browser.execute_script(WRITTEN)
        until(browser, "[...written.values()].flat().some(([text]) => text === 'handle.velocity')")
        tab_to(browser, "Position")
        keys(browser, Keys.ARROW_LEFT, Keys.ENTER, *[Keys.ARROW_RIGHT] * 3, Keys.ENTER)
        until(browser, "document.getElementById('cursor').textContent === 'Δt 150.0 ms'")
        keys(browser, "h")
        until(browser, "!haptic.state().held")
        tab_to(browser, "Light or dark")
        keys(browser, Keys.ENTER)
        until(browser, "document.body.classList.contains('body--dark')")
        choose(browser, "Scene", "detents")
        until(browser, "haptic.state().hello.scene === 'detents' && haptic.rows().length > 10")
        keys(browser, Keys.ESCAPE)
        status, out, _ = served.ended()
        assert (status, out.count("no trip")) == (130, 2)
    browser.get("about:blank")
    browser.get_log("browser")  # that the server is gone is an error to a browser


def test_reset_and_the_copied_command_are_those_of_the_file_and_of_the_page(browser: webdriver.Chrome) -> None:
    """Also in a run that was begun with other values."""
    grants = {"origin": "http://127.0.0.1", "permissions": ["clipboardReadWrite", "clipboardSanitizedWrite"]}
    begun = ("--set", "wall.stiffness=300", "--set", "wall.position=15 mm")
    parameters = "return Object.fromEntries(haptic.state().hello.parameters.map((each) => [each.name, each.value]))"
    with serving("run", "wall", *begun, "--view", "--view-port", "0", "--hand", "none") as served:
        browser.execute_cdp_cmd("Browser.grantPermissions", {**grants, "origin": served.origin})
        screen(browser, 1280, 800)
        opened(browser, served)
        until(browser, "haptic.state().steers")
        assert browser.execute_script(parameters) == {
            "wall.stiffness": 300, "wall.position": 0.015, "wall.damping": 0,
        }  # fmt: skip
        typed(browser, "wall.stiffness", "321.25")
        until(browser, f"{STIFFNESS} === 321.25")
        browser.find_element(By.CSS_SELECTOR, "[aria-label^='Copy the command']").click()
        until(browser, "document.getElementById('answer').textContent.startsWith('copied: ')")
        copied = browser.execute_async_script("navigator.clipboard.readText().then(arguments[0])")
        shown = browser.execute_script(parameters)
        assert browser.find_element(By.ID, "answer").text == f"copied: {copied}"
        browser.find_element(By.CSS_SELECTOR, "[aria-label='Back to the values of the file']").click()
        until(browser, "haptic.state().hello.parameters.map((each) => each.value).join() === '600,0.02,0'")
        ActionChains(browser).send_keys(Keys.ESCAPE).perform()
        assert served.ended()[0] == 130
    browser.get("about:blank")
    browser.get_log("browser")  # that the server is gone is an error to a browser
    program, *words = shlex.split(copied)
    assert program == "haptic-fieldbus"
    with serving(*words, "--view", "--view-port", "0") as served:
        watcher = Watcher(folder() / f"{served.process.pid}.sock")
        hello = watcher.until("hello")
        watcher.reader.close()
    assert {each["name"]: each["value"] for each in hello["parameters"]} == shown
    assert [shown["wall.stiffness"], shown["wall.position"]] == [321.25, 0.015]


def test_stop_that_is_pressed_without_a_connection_is_sent_when_it_is_back(page: Page) -> None:
    browser, served, _ = page
    os.kill(children(served.process.pid)[0], signal.SIGKILL)
    until(browser, "document.body.classList.contains('lost')")
    ActionChains(browser).send_keys(Keys.ESCAPE).perform()
    until(browser, "document.getElementById('lost').textContent.includes('STOP is sent again')")
    assert served.process.poll() is None
    again = ("--run", str(served.process.pid), "--port", str(served.port), "--token", served.token)
    with serving("view", *again) as attached:
        assert served.ended()[0] == 130
        assert attached.ended()[0] == 0
    browser.get("about:blank")
    browser.get_log("browser")  # that the server was gone is an error to a browser


def test_stop_that_is_pressed_without_a_connection_is_sent_by_the_page_that_is_loaded_anew(page: Page) -> None:
    """That is done for a server that does not know the page, and may be sooner than the connection is back."""
    browser, served, _ = page
    os.kill(children(served.process.pid)[0], signal.SIGKILL)
    until(browser, "document.body.classList.contains('lost')")
    browser.execute_script("window.WebSocket = class { constructor() { throw new Error('not yet'); } }")
    ActionChains(browser).send_keys(Keys.ESCAPE).perform()
    again = ("--run", str(served.process.pid), "--port", str(served.port), "--token", served.token)
    with serving("view", *again) as attached:
        assert served.ended()[0] == 130
        assert attached.ended()[0] == 0
    browser.get("about:blank")
    browser.get_log("browser")


def own_address() -> str:
    """Return an address of this computer that is not the loopback; skips the test where there is none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, contextlib.suppress(OSError):
        probe.connect(("192.0.2.1", 9))  # nothing is sent
        if not (found := str(probe.getsockname()[0])).startswith("127."):
            return found
    pytest.skip("needs an address beside the loopback")


def test_a_page_for_other_computers_warns_wants_its_token_and_says_a_command_that_it_cannot_copy(
    browser: webdriver.Chrome,
) -> None:
    host = own_address()
    with serving("run", "wall", "--view-host", host, "--view-port", "0", "--hand", "none") as served:
        assert served.process.stderr is not None
        assert "every computer that reaches this address may steer" in served.process.stderr.readline()
        assert served.address.startswith(f"http://{host}:{served.port}/?token=")
        assert len(served.token) >= 32
        opened(browser, served)
        until(browser, "haptic.state().steers")
        assert browser.execute_script("return navigator.clipboard === undefined")  # the connection is not encrypted
        browser.find_element(By.CSS_SELECTOR, "[aria-label^='Copy the command']").click()
        until(browser, "document.getElementById('answer').textContent.startsWith('haptic-fieldbus run wall')")
        browser.delete_all_cookies()
        for without in ("/", "/?token=", f"/?token={served.token[:-1]}"):
            browser.get(f"http://{host}:{served.port}{without}")
            assert browser.find_element(By.TAG_NAME, "body").text == "refused: no valid token in the address"
        browser.get("about:blank")
        browser.get_log("browser")  # a refusal is an error to a browser
