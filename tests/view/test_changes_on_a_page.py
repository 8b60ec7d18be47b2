"""Changes asked for on a page: what it shows of them, also in the scene that it has begun, and STOP meanwhile."""

import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from tests.view.browsing import Page, opened, typed, until
from tests.view.served import CHROMIUM, DRIVER, serving

pytestmark = [
    pytest.mark.thorough("starts a browser"),
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs: apt-get install chromium chromium-driver"),
    pytest.mark.xdist_group("browser changes_on_a_page"),
]
ANSWER = "document.getElementById('answer')"
SCALE = """
const row = document.querySelector("input[aria-label='wall.stiffness']").closest(".parameter");
const high = Number(row.querySelector("[role=slider]").getAttribute("aria-valuemax"));
return [high, 0.01 * high * Number(row.querySelector(".scale s").style.left.slice(0, -1)),
  Number(row.querySelector("[data-limit]").dataset.limit)];
"""
"""Upper end of the slider of a stiffness from 0, place of the mark below it on the scale of the slider, and limit."""


def test_a_page_is_answered_in_the_scene_that_it_has_begun_too(browser: webdriver.Chrome) -> None:
    with serving("demo", "--no-browser", "--port", "0") as served:
        opened(browser, served)
        browser.execute_script("haptic.scene('detents')")
        until(browser, "haptic.state().hello.scene === 'detents' && haptic.state().steers && haptic.rows().length > 10")
        until(browser, "document.querySelector(\"input[aria-label='detents.amplitude']\")")
        typed(browser, "detents.amplitude", "0.8")
        until(browser, f"{ANSWER}.textContent === 'detents.amplitude = 0.8 is in force.'")
        typed(browser, "detents.amplitude", "-1")
        until(browser, f"{ANSWER}.className === 'refused'")
        field = "document.querySelector(\"input[aria-label='detents.amplitude']\")"
        until(browser, f"{field}.value === '0.8'")


def test_stop_is_not_lost_when_it_is_pressed_while_another_scene_begins(browser: webdriver.Chrome) -> None:
    with serving("demo", "--no-browser", "--port", "0") as served:
        opened(browser, served)
        # The page presses STOP in the moment in which it learns of the other scene.
        browser.execute_script(
            "const send = WebSocket.prototype.send, socket = WebSocket.prototype;"
            "socket.send = function (text) { if (!String(text).includes('stop')) send.call(this, text); };"
            "haptic.stop(); socket.send = send; haptic.scene('detents');"
        )
        assert served.ended()[0] == 130


def test_the_mark_of_a_limit_stands_on_the_scale_of_the_slider_after_a_change_too(browser: webdriver.Chrome) -> None:
    with serving("run", "damped_wall", "--hand", "none", "--view", "--view-port", "0") as served:
        opened(browser, served)
        until(browser, "haptic.state().steers")
        before, mark, limit = browser.execute_script(SCALE)
        assert mark == pytest.approx(limit, rel=0.01)
        typed(browser, "wall.damping", "0.5")
        until(browser, f"{ANSWER}.textContent === 'wall.damping = 0.5 is in force.'")
        until(browser, f"(() => {{ {SCALE} }})()[2] < {limit}")
        after, mark, limit = browser.execute_script(SCALE)
        assert after < 0.8 * before
        assert mark == pytest.approx(limit, rel=0.01)


def test_the_arrows_lead_the_handle_from_where_it_is_while_the_charts_are_held(page: Page) -> None:
    browser, _, _ = page
    until(browser, "haptic.state().steers && document.getElementById('state').textContent === 'torque enabled'")
    browser.execute_script("haptic.hold(); haptic.pull('handle', -0.05)")
    until(browser, "haptic.drawn.handle.position < -0.045")
    browser.execute_script("haptic.pull('handle', null)")
    handle = browser.find_element(By.CSS_SELECTOR, "canvas[data-kind=handle]")
    handle.send_keys(Keys.ARROW_RIGHT)
    assert browser.execute_script("return haptic.state().dragged.target") < -0.02


def test_reset_leaves_out_what_the_run_cannot_change(browser: webdriver.Chrome) -> None:
    """A loop that was begun without damping estimates no velocity."""
    values = ("--set", "wall.damping=0", "--set", "wall.stiffness=400")
    with serving("run", "damped_wall", *values, "--hand", "none", "--view", "--view-port", "0") as served:
        opened(browser, served)
        until(browser, "haptic.state().steers")
        assert browser.execute_script("return haptic.state().hello.parameters.some((each) => each.fixed)")
        typed(browser, "wall.stiffness", "500")
        until(browser, f"{ANSWER}.textContent === 'wall.stiffness = 500 is in force.'")
        browser.execute_script("haptic.reset()")
        until(browser, f"{ANSWER}.textContent === 'wall.stiffness = 600 is in force.'")
