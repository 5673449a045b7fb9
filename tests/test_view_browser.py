"""The pages in a real browser: they open from the disk, ask nobody else for anything, and do what
they are asked to by mouse and by keys."""

import importlib
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from threading import Thread

import pytest
from browser import Driver, chromium, complaints, requested
from test_tables import made
from view_folders import HOSTILE, drawn, experiment, told

from pliant.experiment.rows import Rows
from pliant.report.serve import Server
from pliant.report.view import view
from pliant.teaching import shipped
from pliant.text import visible

pytestmark = pytest.mark.system
PEGS = ("square", "rectangle")
GRAVE = ("serious", "critical")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """6,400 more trials, some with hostile names, and one with a page and a video."""
    cells = [made(0, False, reasoner=r, peg=p) for r in ("rules", "none") for p in PEGS]
    cells[-1] = Rows(trial={**cells[-1].trial, "peg": HOSTILE, "condition": HOSTILE})
    rows = [
        Rows(trial={**cell.trial, **drawn(s), "seed": s, "trial_id": f"{cell.trial_id}{s}"})
        for cell in cells
        for s in range(1600)
    ]
    folder = experiment(tmp_path_factory.mktemp("shown") / "a #1 %20", rows, keep=told(HOSTILE))
    view(folder, [shipped()], film=True)
    return folder


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Driver]:
    with chromium(tmp_path_factory.mktemp("profile")) as driver:
        yield driver


@pytest.fixture(scope="module")
def trial_page(folder: Path) -> str:
    return next((folder / "trials").glob("*/index.html")).as_uri()


@pytest.fixture
def experiment_page(folder: Path) -> str:
    return (folder / "index.html").as_uri()


def opened(browser: Driver, address: str) -> None:
    browser.get("about:blank")  # what follows "#" alone would not open the page anew
    browser.get(address)


def until(browser: Driver, expression: str) -> None:
    """Wait until a JavaScript expression holds."""
    script = f"""
        const done = arguments[0];
        const look = () => (({expression}) ? done(true) : setTimeout(look, 20));
        look();
    """
    browser.set_script_timeout(20)
    assert browser.execute_async_script(script)


def rows(browser: Driver) -> list[list[str]]:
    """The cells of the list's drawn rows, as text."""
    return browser.execute_script(
        "return [...document.querySelectorAll('#list tbody tr')]"
        ".map((r) => [...r.cells].map((c) => c.textContent))"
    )


def column(browser: Driver, name: str) -> list[str]:
    heads = browser.execute_script(
        "return [...document.querySelectorAll('#list th')].map((h) => h.textContent)"
    )
    return [row[heads.index(name)] for row in rows(browser)]


def choose(browser: Driver, label: str, value: str) -> None:
    browser.execute_script(
        """
        const [label, value] = arguments;
        const control = [...document.querySelectorAll('.filters label')]
          .find((l) => l.firstChild.textContent === label).querySelector('select, input');
        control.value = value;
        control.dispatchEvent(new Event(control.tagName === 'SELECT' ? 'change' : 'input'));
        """,
        label,
        value,
    )


def press(browser: Driver, *keys: str) -> None:
    webdriver = importlib.import_module("selenium.webdriver")
    webdriver.ActionChains(browser).send_keys(*keys).perform()


# --- every page ----------------------------------------------------------------------------------


def test_pages_open_from_the_disk_and_ask_nobody_else(
    browser: Driver, trial_page: str, experiment_page: str, folder: Path
) -> None:
    requested(browser), complaints(browser)
    for page in (trial_page, experiment_page):
        opened(browser, page)
        until(browser, "document.readyState === 'complete'")
        assert complaints(browser) == []
    asked = [a for a in requested(browser) if not a.startswith(("data:", "about:"))]
    assert len(asked) > 5
    assert [a for a in asked if not a.startswith(folder.as_uri())] == []


def test_hostile_text_is_shown_and_does_nothing(
    browser: Driver, trial_page: str, experiment_page: str
) -> None:
    for page in (trial_page, experiment_page):
        opened(browser, page)
        browser.execute_script("document.querySelectorAll('details').forEach((d) => d.open = true)")
        shown = browser.execute_script("return document.body.textContent")
        assert visible(HOSTILE) in shown
        assert "owned" not in browser.title
        assert browser.execute_script("return document.querySelectorAll('main b').length") == 0
    assert complaints(browser) == []


def test_a_script_that_got_in_would_not_run(browser: Driver, trial_page: str) -> None:
    opened(browser, trial_page)
    browser.execute_script(
        "const s = document.createElement('script'); s.textContent = 'document.title = 1';"
        "document.body.append(s)"
    )
    assert browser.title != "1"
    assert any("Content Security Policy" in line for line in complaints(browser))


# --- the trial's page ----------------------------------------------------------------------------


def test_the_timeline_seeks_the_video_and_the_card_follows(
    browser: Driver, trial_page: str
) -> None:
    opened(browser, trial_page)
    until(browser, "document.querySelector('video').readyState >= 1")
    video = "document.querySelector('video')"
    begins = browser.execute_script("return data.executions.map((e) => e.video[0])")
    buttons = browser.find_elements("css selector", ".timeline button")
    assert len(buttons) == len(begins) == 5
    buttons[2].click()
    until(browser, f"!{video}.seeking && Math.abs({video}.currentTime - {begins[2]}) < 0.05")
    until(browser, "document.querySelector('.card.current').id === 'execution-3'")
    press(browser, "\ue014", "\ue007")  # right, Enter
    until(browser, f"!{video}.seeking && Math.abs({video}.currentTime - {begins[3]}) < 0.05")
    until(browser, "document.querySelector('.card.current').id === 'execution-4'")
    browser.execute_script(f"{video}.currentTime = {begins[1]} + 0.2")
    until(browser, "document.querySelector('.timeline .current').dataset.execution === '1'")
    assert not browser.find_element("css selector", ".plot .now").get_attribute("hidden")


def test_a_link_to_a_card_unfolds_it(browser: Driver, trial_page: str) -> None:
    opened(browser, trial_page)
    browser.execute_script(
        "for (const one of document.querySelectorAll('details')) one.open = false"
    )
    browser.execute_script("location.hash = '#execution-3'")
    until(browser, "document.querySelector('#execution-3 > details').open")
    assert not browser.execute_script(
        "return document.querySelector('#execution-2 > details').open"
    )


def test_a_click_in_a_plot_takes_the_video_to_its_time(browser: Driver, trial_page: str) -> None:
    opened(browser, trial_page)
    video = "document.querySelector('video')"
    until(browser, f"{video}.readyState >= 1")
    middle = browser.execute_script(
        """
        const { time: [from, to], video: [begins, judged] } = data.executions[3];
        const [plot] = plots, { left, top } = plot.over.getBoundingClientRect();
        const at = { clientX: left + plot.valToPos((from + to) / 2, "x"), clientY: top + 40 };
        for (const kind of ["mousedown", "mouseup", "click"])
          plot.over.dispatchEvent(new MouseEvent(kind, { ...at, bubbles: true }));
        return (begins + judged) / 2;
        """
    )
    until(browser, f"!{video}.seeking && Math.abs({video}.currentTime - {middle}) < 0.1")
    until(browser, "document.querySelector('.card.current').id === 'execution-4'")
    assert not browser.find_element("css selector", ".plot .now").get_attribute("hidden")


def test_the_plots_are_drawn(browser: Driver, trial_page: str) -> None:
    opened(browser, trial_page)
    until(browser, "document.querySelectorAll('.plot canvas').length === 4")
    colours = browser.execute_script(
        """
        return [...document.querySelectorAll('.plot canvas')].map((c) => {
          const { data } = c.getContext('2d').getImageData(0, 0, c.width, c.height);
          return new Set(new Uint32Array(data.buffer)).size;
        });
        """
    )
    assert min(colours) > 10


# --- the experiment's page -----------------------------------------------------------------------


def test_filters_filter_and_stay_in_the_address(browser: Driver, experiment_page: str) -> None:
    opened(browser, experiment_page)
    assert len(rows(browser)) == 100  # of many: the rest on request
    choose(browser, "reasoner", "none")
    choose(browser, "condition", "all")
    choose(browser, "peg", "circle")
    assert set(column(browser, "reasoner")) == {"none"}
    assert len(rows(browser)) == 8
    choose(browser, "outcome", "failed")
    assert len(rows(browser)) == 6
    choose(browser, "seed", "3-4")
    assert column(browser, "seed") == ["3", "4"]
    address = browser.current_url
    opened(browser, address)
    assert column(browser, "seed") == ["3", "4"]


def test_columns_sort_both_ways(browser: Driver, experiment_page: str) -> None:
    opened(browser, f"{experiment_page}#peg=circle&condition=all&reasoner=rules")
    head = next(
        b for b in browser.find_elements("css selector", "#list th button") if b.text == "seed"
    )
    head.click()
    assert column(browser, "seed") == [str(n) for n in range(1, 9)]
    head.click()
    assert column(browser, "seed") == [str(n) for n in range(8, 0, -1)]
    assert head.find_element("xpath", "..").get_attribute("aria-sort") == "descending"


def test_a_cell_leads_to_its_failures_and_they_to_their_pages(
    browser: Driver, experiment_page: str, trial_page: str
) -> None:
    opened(browser, experiment_page)
    failures = "#table2 ~ * a[href*='reasoner=none'][href*='failed']"
    link = browser.find_element("css selector", failures)
    browser.execute_script("arguments[0].click()", link)
    until(browser, "document.querySelectorAll('#list tbody tr').length === 6")
    assert set(column(browser, "inserted")) == {"✗ no"}
    assert "pliant run --peg circle" in rows(browser)[0][0]
    opened(browser, f"{experiment_page}#condition=none")
    browser.find_element("link text", "page").click()
    assert browser.current_url == trial_page
    browser.find_element("link text", "← the experiment").click()
    assert browser.current_url == experiment_page


def test_a_column_of_a_chart_leads_to_its_trials(browser: Driver, experiment_page: str) -> None:
    opened(browser, experiment_page)
    for n in range(len(browser.find_elements("css selector", ".panels a"))):
        described = browser.execute_script(
            """
            const chosen = document.querySelectorAll('.panels a')[arguments[0]];
            chosen.dispatchEvent(new MouseEvent('click', { bubbles: true }));
            return chosen.getAttribute('aria-label');
            """,
            n,
        )
        count = described.partition("% of ")[2].partition(" ")[0] or "0"
        until(
            browser, f"document.querySelector('[role=status]').textContent.startsWith('{count} ')"
        )
    browser.find_element("css selector", ".chips button").click()
    assert not browser.find_elements("css selector", ".chips button")


def test_what_one_inserted_and_the_other_did_not(browser: Driver, experiment_page: str) -> None:
    where = "peg=circle&condition=all&reasoner=none&outcome=failed&against=rules"
    opened(browser, f"{experiment_page}#{where}")
    assert column(browser, "seed") == ["3", "4", "5", "6", "7"]


# --- served --------------------------------------------------------------------------------------


def test_served_pages_seek_too(browser: Driver, folder: Path) -> None:
    server = Server(folder)
    thread = Thread(target=server.run)
    thread.start()
    try:
        requested(browser)
        opened(browser, server.address)
        browser.get(f"{server.address}#condition=none")
        until(browser, "document.querySelector('#list a') !== null")
        browser.find_element("link text", "page").click()
        until(browser, "document.querySelector('video')?.readyState >= 1")
        browser.find_elements("css selector", ".timeline button")[4].click()
        until(
            browser,
            "!document.querySelector('video').seeking"
            " && document.querySelector('video').currentTime > 5",
        )
        asked = [a for a in requested(browser) if not a.startswith(("data:", "about:"))]
        assert [a for a in asked if not a.startswith(server.address)] == []
        assert complaints(browser) == []
    finally:
        server.close()
        thread.join()


# --- for everybody -------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1400, 420])
def test_axe_finds_no_serious_barrier_on_either_page(
    browser: Driver, experiment_page: str, trial_page: str, width: int, scheme: str
) -> None:
    axe = resources.files("axe_core_python") / "axe.min.js"
    browser.set_script_timeout(120)  # of thousands of rows, on a loaded machine
    browser.set_window_size(width, 900)
    preferred = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", preferred)
    for page in (experiment_page, trial_page):
        opened(browser, page)
        browser.execute_script(axe.read_text(encoding="utf-8"))
        found = browser.execute_async_script(
            "const done = arguments[0]; axe.run().then((r) => done(r.violations));"
        )
        grave = [(v["id"], v["nodes"][0]["html"]) for v in found if v["impact"] in GRAVE]
        assert not grave, page
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    browser.set_window_size(1280, 900)
