"""The page in a real headless Chromium: it moves as the simulation does, steers, refuses, stops, and is seen dead."""

import csv
import math
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from selenium import webdriver
from selenium.webdriver import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import WebDriverWait

from haptic_fieldbus.running.live import folder
from tests.running.test_live import Watcher
from tests.view.browsing import PATIENCE, STANDING, WRITTEN, Page, opened, screen, typed, until
from tests.view.served import CHROMIUM, DRIVER, GROWTH, children, descendants, memory_of, serving

pytestmark = [
    pytest.mark.thorough("starts a browser"),
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs: apt-get install chromium chromium-driver"),
    pytest.mark.xdist_group("browser page"),
]


def recorded(path: Path) -> dict[int, dict[str, float]]:
    """Return the rows of a record by their instants [ns]."""
    with path.open() as file:
        return {int(row["t_ns"]): {name: float(value) for name, value in row.items()} for row in csv.DictReader(file)}


def test_the_handle_is_drawn_where_the_simulation_has_it(page: Page) -> None:
    browser, served, record = page
    drawn = []
    for target in (0.01, 0.03, -0.02):
        browser.execute_script(f"haptic.send({{pull: ['handle', {target}]}})")
        for _ in range(5):
            drawn.append(browser.execute_script("return {...haptic.drawn.handle}"))
            # No newer rows than those of the present picture wait to be drawn for longer than two pictures.
            behind = browser.execute_async_script(
                "const done = arguments[0], pictures = haptic.rows().at(-1)[0]; requestAnimationFrame(() =>"
                " requestAnimationFrame(() => done(pictures - haptic.drawn.handle.t_ns)));"
            )
            assert behind <= 0
    width = browser.execute_script("return document.querySelector('canvas[data-kind=handle]').clientWidth")
    ActionChains(browser).send_keys(Keys.ESCAPE).perform()
    assert served.ended()[0] == 130
    rows = recorded(record)
    assert max(each["position"] for each in drawn) > 0.015
    for each in drawn:
        place = rows[each["t_ns"]]["handle.position"]
        assert each["position"] == place
        assert each["x"] == pytest.approx(30 + (place + 0.1) / 0.2 * (width - 60))


def slider(browser: webdriver.Chrome, name: str) -> WebElement:
    """Return the slider of a parameter, which takes the keys."""
    found = f"[data-name='{name}'][role=slider], [data-name='{name}'] [role=slider]"
    return browser.find_element(By.CSS_SELECTOR, found)


def test_a_value_changes_the_loop_and_an_unstable_one_is_refused_with_the_limit(page: Page) -> None:
    browser, served, record = page
    typed(browser, "wall.stiffness", "700")
    until(browser, "document.getElementById('answer').className === 'made'")
    assert browser.find_element(By.ID, "answer").text == "wall.stiffness = 700 is in force."
    assert browser.find_element(By.CLASS_NAME, "limit").text == "Limit: 750 N/m; 700 is inside, margin 1.07"
    browser.execute_script("haptic.send({pull: ['handle', 0.03]})")
    until(browser, "haptic.drawn.handle.position > 0.021")
    typed(browser, "wall.stiffness", "5000")
    until(browser, "document.getElementById('answer').className === 'refused'")
    assert "exceeds the limit of 750 N/m" in browser.find_element(By.ID, "answer").text
    until(browser, "document.querySelector(\"input[aria-label='wall.stiffness']\").value === '700'")
    thumb = slider(browser, "wall.stiffness")
    WebDriverWait(browser, PATIENCE, 0.1).until(lambda _: thumb.get_attribute("aria-valuenow") == "700")
    assert browser.find_element(By.CSS_SELECTOR, "[data-limit]").text == "limit 750 N/m"
    # By the keyboard alone, on the slider itself.
    thumb = slider(browser, "wall.position").find_element(By.CSS_SELECTOR, "[tabindex='0']")
    browser.execute_script("arguments[0].focus()", thumb)
    ActionChains(browser).send_keys(Keys.ARROW_LEFT).perform()
    until(browser, "haptic.state().hello.parameters[1].value < 0.02")
    browser.find_element(By.ID, "stop").send_keys(Keys.ENTER)
    assert served.ended()[0] == 130
    deep = [row for row in recorded(record).values() if row["handle.position"] > 0.0205 and row["handle.gain"] == 1.0]
    stiffness = {round(row["handle.force"] / (0.02 - row["handle.position"])) for row in deep if row["handle.force"]}
    assert 700 in stiffness


def test_a_change_that_waits_is_listed_until_it_begins_and_the_picture_is_that_of_the_scene_in_force(
    page: Page,
) -> None:
    browser, served, _ = page
    until(browser, "haptic.state().steers && document.getElementById('state').textContent === 'torque enabled'")
    browser.execute_script("haptic.pull('handle', 0.035)")
    until(browser, "haptic.drawn.handle.asked < -1")
    browser.execute_script("haptic.change('wall.position', -0.02)")
    waits = "document.getElementById('waits').textContent.startsWith('waits: wall.position = -0.02. It begins when')"
    until(browser, waits)
    browser.execute_script("haptic.change('wall.stiffness', -1)")
    until(browser, "document.getElementById('answer').className === 'refused'")
    assert browser.execute_script(f"return {waits}")
    surface = "haptic.state().hello.axes[0].surfaces[0].at"
    assert browser.execute_script(f"return {surface}") == 0.02
    browser.execute_script("haptic.pull('handle', -0.03)")
    until(browser, f"{surface} === -0.02 && !document.getElementById('waits').textContent")
    assert served.process.poll() is None


def test_the_hand_by_mouse_and_by_keys_moves_the_handle_into_the_wall(page: Page) -> None:
    browser, _, _ = page
    canvas = browser.find_element(By.CSS_SELECTOR, "canvas[data-kind=handle]")
    until(browser, "haptic.state().steers")
    width = canvas.size["width"]
    to = int(30 + (0.035 + 0.1) / 0.2 * (width - 60) - width / 2)
    ActionChains(browser).move_to_element(canvas).click_and_hold().move_by_offset(to, 0).perform()
    until(browser, "haptic.drawn.handle.asked < -1")
    ActionChains(browser).release().perform()
    until(browser, "haptic.drawn.handle.asked > -1")
    canvas.send_keys(Keys.ARROW_RIGHT * 12)
    until(browser, "haptic.drawn.handle.asked < -1")
    canvas.send_keys(Keys.ENTER)
    until(browser, "haptic.drawn.handle.asked > -1")


def test_the_simulation_pauses_goes_one_period_forward_and_slower(page: Page) -> None:
    browser, _, _ = page
    browser.set_script_timeout(PATIENCE)
    ActionChains(browser).send_keys("p").perform()
    until(browser, "haptic.state().paused && document.getElementById('state').textContent === 'paused'")
    before = browser.execute_async_script(STANDING)
    for number in (1, 2, 3):
        ActionChains(browser).send_keys("n").perform()
        until(browser, f"haptic.state().next > {before + number - 1}")
        assert browser.execute_async_script(STANDING) == before + number
    browser.execute_script("haptic.send({speed: 0.1})")
    ActionChains(browser).send_keys("p").perform()
    until(browser, f"haptic.state().speed === 0.1 && haptic.state().next > {before + 50}")


def test_stop_takes_the_torque_away_in_time(page: Page) -> None:
    browser, served, record = page
    browser.execute_script("haptic.send({pull: ['handle', 0.035]})")
    until(browser, "haptic.drawn.handle.given < -1")
    # In slow motion, so that a loaded machine has the time that the real one needs.
    browser.execute_script("haptic.send({speed: 0.02})")
    until(browser, "haptic.state().speed === 0.02")
    pressed = browser.execute_script("haptic.stop(); return haptic.rows().at(-1)[0]")
    assert served.ended()[0] == 130
    assert max(recorded(record)) - pressed <= 50_000_000


def test_a_second_page_looks_and_a_lost_connection_is_seen(page: Page) -> None:
    browser, served, _ = page
    until(browser, "haptic.state().steers")
    first = browser.current_window_handle
    browser.switch_to.new_window("window")
    opened(browser, served)
    assert browser.execute_script("return haptic.state().steers") is False
    assert "Another page steers" in browser.find_element(By.ID, "role").text
    until(browser, "document.querySelector(\"input[aria-label='wall.stiffness']\").disabled")
    browser.execute_script("haptic.change('wall.stiffness', 123)")
    browser.close()
    browser.switch_to.window(first)
    assert browser.execute_script("return haptic.state().hello.parameters[0].value") == 600
    os.kill(children(served.process.pid)[0], signal.SIGKILL)
    until(browser, "document.body.classList.contains('lost') && !document.getElementById('lost').hidden")
    assert "Connection lost" in browser.find_element(By.ID, "lost").text
    assert served.process.poll() is None
    browser.get("about:blank")
    browser.get_log("browser")  # that the server is gone is an error to a browser


def test_a_page_that_is_reloaded_again_and_again_leaves_run_and_server_as_they_are(page: Page) -> None:
    browser, served, _ = page
    (server,) = children(served.process.pid)
    for number in range(50):
        if number == 5:
            before = memory_of(server)
        browser.get(served.address)
        until(browser, "haptic.rows().length > 10")
    # The server keeps the controls of each page for a while, because it may come back.
    assert memory_of(server) - before < 45 * KEPT_PAGE
    until(browser, "haptic.state().steers")
    assert served.process.poll() is None


KEPT_PAGE = 2_000_000
"""Largest memory of the controls of a page [octets]."""
FROZEN = 60.0
"""Time for which a page stands still [s]."""


def test_a_page_that_was_frozen_is_young_again_at_once_and_has_cost_no_memory(page: Page) -> None:
    browser, served, _ = page
    (server,) = children(served.process.pid)
    watcher = Watcher(folder() / f"{served.process.pid}.sock")
    watcher.until("hello")
    assert watcher.ring is not None
    ring, place = watcher.ring, watcher.columns.index("t_ns")
    before, pushed = memory_of(server), ring.pushed
    stopped = descendants(browser.service.process.pid)  # the driver goes on
    for pid in stopped:
        os.kill(pid, signal.SIGSTOP)
    time.sleep(FROZEN)
    grown, went_on = memory_of(server) - before, ring.pushed - pushed
    for pid in stopped:
        os.kill(pid, signal.SIGCONT)
    thawed = time.monotonic()
    ages: list[float] = []
    while not ages or ages[-1] >= 0.2:
        assert time.monotonic() < thawed + PATIENCE
        shown_ns = browser.execute_script("return haptic.rows().at(-1)[0]")
        ages.append(1e-9 * (ring.since(ring.pushed - 1)[1][-1, place] - shown_ns))
    assert grown < GROWTH
    assert went_on > 100 * FROZEN  # of 1000 a second, on whatever machine
    until(browser, "haptic.state().steers && !document.body.classList.contains('lost')")
    watcher.reader.close()


def test_a_required_page_keeps_a_run_that_stands_still_and_ends_it_when_it_is_closed(
    browser: webdriver.Chrome,
) -> None:
    """A page draws nothing in a pause, nor while a question waits at the terminal."""
    browser.set_script_timeout(PATIENCE)
    with serving("run", "wall", "--view-required", "--view-port", "0", "--hand", "none") as served:
        opened(browser, served)
        browser.execute_script("haptic.pause()")
        until(browser, "haptic.state().paused")
        browser.execute_async_script("setTimeout(arguments[0], 4000)")
        assert served.process.poll() is None
        assert browser.execute_script("return !haptic.state().ended")
        browser.get("about:blank")
        assert served.ended()[0] == 1


def overflows(browser: webdriver.Chrome) -> Callable[[str], bool]:
    return lambda side: browser.execute_script(f"return document.documentElement.scroll{side} > window.inner{side}")


def test_a_scene_chosen_on_the_page_begins_and_a_rotary_handle_stands_at_its_angle(browser: webdriver.Chrome) -> None:
    drawn_now = "haptic.drawn[haptic.state().hello.axes[0].name]"
    with serving("demo", "--no-browser", "--port", "0") as served:
        screen(browser, 1280, 800)
        opened(browser, served)
        browser.execute_script("haptic.scene('knob_menu')")
        until(browser, f"haptic.state().hello.scene === 'knob_menu' && {drawn_now}.t_ns > 0")
        until(browser, "document.querySelector('h1').textContent.startsWith('knob_menu')")
        axis = browser.execute_script("return haptic.state().hello.axes[0]")
        assert axis["rotary"]
        until(browser, "haptic.state().steers && haptic.rows().at(-1)[haptic.state().hello.columns.indexOf('enabled')]")
        # Led with the mouse to a quarter of a turn, from above: to the right.
        canvas = browser.find_element(By.CSS_SELECTOR, "canvas[data-kind=handle]")
        ActionChains(browser).move_to_element_with_offset(canvas, 2, -40).click_and_hold().move_by_offset(
            60, 44
        ).perform()
        until(browser, f"{drawn_now}.position > 0.5")
        drawn, centre, radius = browser.execute_script(
            "const canvas = document.querySelector('canvas[data-kind=handle]');"
            f"return [{{...{drawn_now}}}, canvas.centre, canvas.placeOf(Math.PI / 2) - canvas.centre[0]];"
        )
        assert drawn["x"] == pytest.approx(centre[0] + radius * math.sin(drawn["position"]))
        ActionChains(browser).release().perform()
        ActionChains(browser).send_keys(Keys.ESCAPE).perform()
        assert served.ended()[0] == 130


def test_a_trip_stays_on_the_page_in_words_and_the_charts_are_held(browser: webdriver.Chrome, tmp_path: Path) -> None:
    faults = tmp_path / "faults.toml"
    faults.write_text('[[fault]]\nkind = "hand_hit"\nat = 8.0\nforce = 60.0\n', encoding="utf-8")
    with serving("run", "wall", "--view", "--view-port", "0", "--faults", str(faults)) as served:
        screen(browser, 1280, 800)
        opened(browser, served)
        until(browser, "!document.getElementById('trip').hidden")
        until(browser, "haptic.state().ended")
        text = browser.find_element(By.ID, "trip").text
        assert "limit" in text
        assert (
            browser.execute_script("return [haptic.state().held, document.getElementById('stop').disabled]")
            == [True] * 2
        )
        screen(browser, 390, 844)
        browser.execute_script("scrollTo(0, document.body.scrollHeight)")
        box = browser.execute_script("return document.getElementById('trip').getBoundingClientRect().toJSON()")
        assert [box["top"] >= 0, box["bottom"] <= 844, box["height"] > 20] == [True] * 3, "in sight wherever one is"
        status, out, err = served.ended()
        assert status == 3
        assert text.partition(" ")[2] in " ".join((out + err).split())
        assert "torque is off" in text, "known at the end only, when the drives were asked"
    browser.get("about:blank")
    browser.get_log("browser")  # that the server is gone is an error to a browser


def test_a_column_that_crosses_a_level_holds_the_charts_with_the_crossing_in_the_middle(page: Page) -> None:
    browser, _, _ = page
    browser.execute_script("haptic.span(2); haptic.arm({column: 'handle.position'})")
    browser.find_element(By.CSS_SELECTOR, "input[aria-label='Level']").send_keys("15")
    until(browser, "document.getElementById('cursor').textContent === 'trigger: handle.position at 15 mm'")
    browser.execute_script("haptic.send({pull: ['handle', 0.03]})")
    until(browser, "haptic.state().held")
    marks, held = browser.execute_script(
        "const {marks, hello} = haptic.state(), place = hello.columns.indexOf('handle.position');"
        "return [marks, haptic.shown().map((row) => [row[0] * 1e-9, row[place]])];"
    )
    (crossing,) = marks
    before = [where for at, where in held if crossing - 0.0035 <= at <= crossing - 0.0005]
    after = [where for at, where in held if crossing <= at <= crossing + 0.003]
    assert max(before) < 0.015 <= min(after)
    assert held[-1][0] - crossing == pytest.approx(1.0, abs=0.0015)
    browser.execute_script("document.activeElement.blur()")
    ActionChains(browser).send_keys("h").perform()
    until(browser, "!haptic.state().held")
    browser.execute_script("haptic.send({pull: ['handle', 0.0]})")  # armed again, in the other direction
    until(browser, "haptic.state().held")


def test_a_hand_chosen_on_the_page_takes_the_handle_and_the_pointer_takes_it_from_it(page: Page) -> None:
    browser, _, _ = page
    choice = browser.find_element(By.CSS_SELECTOR, "[aria-label='Hand']")
    browser.execute_script("arguments[0].click()", choice)
    option = "//*[@role='option'][normalize-space()='push']"
    WebDriverWait(browser, PATIENCE, 0.1).until(lambda _: browser.find_elements(By.XPATH, option))
    browser.execute_script("arguments[0].click()", browser.find_element(By.XPATH, option))
    until(browser, "haptic.drawn.handle.asked < -4")  # a push of 6 N
    browser.refresh()
    until(browser, "/Hand\\s+push/.test(document.querySelector('.simulation').innerText)")
    until(browser, "haptic.state().steers")  # the page before the refresh may leave late
    browser.execute_script("haptic.pull('handle', -0.03)")
    until(browser, "haptic.drawn.handle.position < -0.025")
    browser.execute_script("haptic.send({speed: 0.5})")
    until(browser, "haptic.state().speed === 0.5 && haptic.state().dragged")
    browser.execute_script("haptic.send({hand: 'push'})")  # which takes the handle from the pointer
    until(browser, "!haptic.state().dragged")


def test_charts_show_chosen_columns_hold_measure_save_and_are_remembered(page: Page, tmp_path: Path) -> None:
    browser, served, record = page
    browser.execute_cdp_cmd(
        "Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path / "saved")}
    )
    # Several columns in one chart, by the choice of the chart itself.
    choice = browser.find_element(By.CSS_SELECTOR, "[aria-label='Columns of the chart error']")
    browser.execute_script("arguments[0].click()", choice)
    for name in ("handle.velocity", "lateness_us"):
        option = f"[...document.querySelectorAll('[role=option]')].find((each) => each.textContent.trim() === '{name}')"
        until(browser, option)
        browser.execute_script(f"{option}.click()")
        until(browser, f"{option}.ariaSelected === 'true'")
    ActionChains(browser).send_keys(Keys.TAB).perform()
    browser.execute_script("haptic.span(2)")
    browser.execute_script(WRITTEN)
    both = (
        "((all) => all.includes('handle.velocity') && all.includes('lateness_us'))([...written].filter(([each]) =>"
        " each.dataset.name === 'error').flatMap(([, words]) => words.map(([text]) => text)))"
    )
    until(browser, both)
    # Held: the charts stand, the run goes on, and two cursors measure the time between them.
    browser.find_element(By.ID, "hold").click()
    held = browser.execute_script("return [haptic.shown().at(-1)[0], haptic.state().next]")
    until(browser, f"haptic.state().next > {held[1] + 50}")
    assert browser.execute_script("return haptic.shown().at(-1)[0]") == held[0]
    until(browser, f"haptic.drawn.handle.t_ns > {held[0]}")  # the handle and the state go on
    chart = browser.find_element(By.CSS_SELECTOR, "canvas[data-name=position]")
    for offset in (-40, 60):
        ActionChains(browser).move_to_element_with_offset(chart, offset, 0).click().perform()
    width = chart.size["width"] - 70
    apart = float(until(browser, "document.getElementById('cursor').textContent.startsWith('Δt') &&"
                                 " document.getElementById('cursor').textContent").split()[1])  # fmt: skip
    assert apart == pytest.approx(1e3 * 2.0 * 100 / width, rel=0.03)
    # Saved: the rows of the window are those of the record, and the picture shows something.
    window = browser.execute_script("return haptic.shown().map((row) => row[0])")
    browser.find_element(By.CSS_SELECTOR, "[aria-label='Save the window as CSV']").click()
    browser.find_element(By.CSS_SELECTOR, "[aria-label='Save the window as PNG']").click()
    saved, drawn = tmp_path / "saved" / "wall.csv", tmp_path / "saved" / "wall.png"
    WebDriverWait(browser, PATIENCE, 0.1).until(lambda _: saved.exists() and drawn.exists())
    assert drawn.read_bytes().startswith(b"\x89PNG")
    assert len(drawn.read_bytes()) > 10_000
    # Remembered by a page that is opened anew.
    browser.execute_script("haptic.theme()")
    dark = browser.execute_script("return Quasar.Dark.isActive")
    opened(browser, served)
    browser.execute_script(WRITTEN)
    until(browser, both)
    assert browser.execute_script("return Quasar.Dark.isActive") == dark
    until(browser, "haptic.shown().at(-1)[0] - haptic.shown()[0][0] > 1.9e9")
    assert browser.execute_script("return haptic.shown().at(-1)[0] - haptic.shown()[0][0]") <= 2.0e9
    browser.find_element(By.ID, "stop").click()
    assert served.ended()[0] == 130
    rows, found = recorded(record), recorded(saved)
    assert [*found] == [int(each) for each in window]
    assert all(found[at][name] == rows[at][name] for at in found for name in rows[at])


def lying_on_another(browser: webdriver.Chrome) -> list[tuple[str, str]]:
    """Return the pairs of words on one canvas of which one lies on the other, and those that are cut off."""
    until(browser, "window.written && window.written.size === document.querySelectorAll('canvas[data-kind]').length")
    canvases = browser.execute_script(
        "return [...window.written].map(([canvas, words]) => [canvas.clientWidth, words.map((each) => [...each])])"
    )
    found = []
    for width, words in canvases:
        for number, (text, left, right, base) in enumerate(words):
            found += [(text, other) for other, begin, end, line in words[number + 1 :]
                      if abs(line - base) < 11 and begin < right and left < end]  # fmt: skip
            found += [(text, "the edge")] if left < 0 or right > width else []
    return found


def without_a_scale(browser: webdriver.Chrome) -> list[str]:
    """Return the pictures of forces and of times beside which fewer than two numbers stand."""
    counted = """return [...window.written].filter(([canvas]) => canvas.dataset.kind !== "handle").map(
        ([canvas, words]) => [canvas.ariaLabel, words.filter(([text, , right, base]) => Number.isFinite(Number(text))
            && right < 52 && base > 22 && base < canvas.clientHeight - 12).length])"""
    return [name for name, count in browser.execute_script(counted) if count < 2]


@pytest.mark.parametrize("scene", ["detents", "virtual_coupling", "knob_menu", "virtual_shaft", "teleoperation"])
def test_no_word_of_a_picture_lies_on_another_one_at_any_width(browser: webdriver.Chrome, scene: str) -> None:
    with serving("run", scene, "--view", "--view-port", "0", "--hand", "none") as served:
        screen(browser, 1280, 800)
        opened(browser, served)
        browser.execute_script(WRITTEN)
        for width, height in ((1280, 800), (1120, 700), (1000, 660), (1920, 1080), (390, 844)):
            screen(browser, width, height)
            browser.execute_async_script(
                "requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(arguments[0], 300)))"
            )
            assert lying_on_another(browser) == []
            assert without_a_scale(browser) == []
            assert not browser.execute_script("return document.body.classList.contains('lost')")
            lowest = "Math.min(...[...document.querySelectorAll('canvas[data-kind]')].map((each) => each.clientHeight))"
            assert browser.execute_script(f"return {lowest}") >= 85
            cut = browser.execute_script(
                "return [...document.querySelectorAll('.parameter input')]"
                ".filter((each) => each.scrollWidth > each.clientWidth).map((each) => each.ariaLabel + each.value)"
            )
            assert cut == []


def test_the_first_screen_needs_no_scrolling_and_each_control_has_a_name(page: Page) -> None:
    browser, _, _ = page
    for width, height in ((1280, 800), (1920, 1080), (390, 844)):
        screen(browser, width, height)
        wide = overflows(browser)
        assert not wide("Width")
        assert width < 500 or not wide("Height")
        box = browser.execute_script("return document.getElementById('stop').getBoundingClientRect().toJSON()")
        assert [box["left"] >= 0, box["right"] <= width, box["top"] >= 0, box["bottom"] <= height] == [True] * 4
    nameless = browser.execute_script(
        "return [...document.querySelectorAll('button, input, [role=slider], canvas')].filter((each) =>"
        " each.offsetParent && !(each.ariaLabel || each.title || each.textContent.trim() ||"
        " each.closest('[aria-label]'))).map((each) =>"
        " each.outerHTML)"
    )
    assert nameless == []
    touched = "(each) => [each.dataset.kind, getComputedStyle(each).touchAction]"
    found = browser.execute_script(f"return [...document.querySelectorAll('canvas')].map({touched})")
    assert {*map(tuple, found)} == {
        ("handle", "none"), ("law", "pan-y"), ("chart", "pan-y")
    }, "a finger scrolls a page that is longer than its screen"  # fmt: skip
