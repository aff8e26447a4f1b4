"""The leaderboard as one HTML page: that it needs nothing else, what is embedded, and what a browser does with it."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select

from mpge_bench.leaderboard import estimates
from mpge_bench.leaderboard.board import board_html
from mpge_bench.leaderboard.results import collect

#: Text that would be code if it were not escaped wherever it goes.
HOSTILE = "</script><img src=x onerror=document.title=0>"
_QUIET = ("--disable-background-networking", "--disable-component-update", "--disable-quic", "--disable-sync", "--no-first-run")


@pytest.fixture(scope="module", autouse=True)
def _few_resamples():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimates, "_RESAMPLES", 20)
        yield


def written(folder, write_result):
    """Results of three methods of different access on a development pair and on two headline pairs; their settings are alike."""
    for task, more in {"one": {"development": True}, "two": {}, "three": {}}.items():
        for method, access, score in (("plain", [], 0.1), ("copies", ["transitions"], 0.9), ("resetter", ["resets", "transitions"], 0.45)):
            for seed in range(2):
                names = {"task": task, "method": method, "seed": seed, "access": access, "settings": {"steps": 1000, "agent": {"gamma": 0.99}}} | more
                write_result(folder / task / method / f"seed{seed}" / "result.json", score + 0.01 * seed, **names)
    # Not to be normalised.
    write_result(folder / "three" / "broken" / "result.json", None, task="three", method="broken")
    return folder


def page_of(store):
    page = store.parent / "index.html"
    page.write_text(board_html(collect(store), page), "utf-8")
    return page


@pytest.fixture(scope="module")
def store(tmp_path_factory, write_result):
    return written(tmp_path_factory.mktemp("board") / "results", write_result)


@pytest.fixture(scope="module")
def page(store):
    return page_of(store)


def embedded(page):
    (data,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', page.read_text("utf-8"), re.S)
    return data, json.loads(data)


def test_one_file_is_enough(page):
    text = page.read_text("utf-8")
    assert not re.findall(r'(?:src|href)="(?!#)|url\((?!#)|@import|<link', text)
    (script,) = re.findall(r"<script>(.*?)</script>", text, re.S)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{digest}'" in text


def test_the_same_results_give_the_same_page(store, page):
    assert board_html(collect(store), page) == page.read_text("utf-8")


def test_each_run_is_embedded_whole_and_what_runs_have_alike_once(page):
    _, data = embedded(page)
    assert len(data["runs"]) == 19
    for run in data["runs"]:
        link = run.pop("link")
        whole = {key: data["parts"][value[0]] if isinstance(value, list) else value for key, value in run.items()}
        assert whole == json.loads((page.parent / link).read_text())
    assert len({run["settings"][0] for run in data["runs"] if run["method"] != "broken"}) == 1
    assert len(data["parts"]) == len({json.dumps(part) for part in data["parts"]})


def test_text_of_results_stays_text(browser, tmp_path, write_result):
    names = {"method": HOSTILE, "task": HOSTILE, "variant": HOSTILE, "commit": HOSTILE, "track": HOSTILE, "settings": {HOSTILE: float("nan")}}
    write_result(tmp_path / "javascript:0" / HOSTILE.replace("/", "") / "result.json", 0.5, **names)
    page = page_of(tmp_path / "javascript:0")
    raw, data = embedded(page)
    assert "<" not in raw
    (run,) = data["runs"]
    assert run["method"] == HOSTILE
    assert data["parts"][run["settings"][0]] == {HOSTILE: "nan"}
    assert "<img" not in page.read_text("utf-8")
    board = Board(browser, page)
    board.click(browser.find_element(By.CSS_SELECTOR, "td button"))
    dialog = browser.find_element(By.TAG_NAME, "dialog")
    assert f"Settings: {HOSTILE} on {HOSTILE}" in dialog.text
    assert dialog.find_element(By.TAG_NAME, "a").get_attribute("href").startswith("file:")
    assert browser.title == "Leaderboard – mpge_bench"
    assert board.complaints() == []


def test_every_number_leads_to_runs(page):
    rows = re.findall(r"<tr data-access.*?>", page.read_text("utf-8"))
    assert len(rows) == 3 + 3 + 2 * 10  # pairs; methods over the two headline pairs; returns and costs
    assert all("data-runs=" in row for row in rows)


def test_the_command_writes_the_page_at_once_or_says_why_not(tmp_path, write_result, in_process, refused):
    store = tmp_path / "results"
    for seed in range(2):
        write_result(store / f"seed{seed}" / "result.json", 0.5, seed=seed)
    page = tmp_path / "made" / "index.html"
    code, out, err = in_process("leaderboard", store, "--html", page)
    assert (code, f"Page: {page}" in err) == (0, True)
    assert "Test pairs, headline track" in out
    assert list(page.parent.iterdir()) == [page]
    before = page.read_bytes()
    assert "choose another file with --html" in refused("leaderboard", store, "--html", store)
    assert "give it alone" in refused("leaderboard", "--html", page, "--update")
    result = store / "seed0" / "result.json"
    result.write_text(json.dumps(json.loads(result.read_text()) | {"fingerprints": {"robot": "other", "pair": "bb"}}))
    assert "differ in their physics and do not compare" in refused("leaderboard", store, "--html", page)
    assert page.read_bytes() == before


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    found = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chromium-browser"))), None)
    driver = shutil.which("chromedriver")
    if not (found and driver):
        pytest.skip("no Chromium with its chromedriver found")
    options = webdriver.ChromeOptions()
    options.binary_location = found
    profile = tmp_path_factory.mktemp("profile")
    for argument in ("--headless", "--no-sandbox", "--disable-gpu", "--window-size=1300,1000", f"--user-data-dir={profile}", *_QUIET):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    made = webdriver.Chrome(options=options, service=Service(driver))
    yield made
    made.quit()


class Board:
    """The page in the browser, as a user has it."""

    def __init__(self, browser, page):
        self.browser = browser
        browser.get(page.as_uri())

    def table(self, title, section="headline"):
        xpath = f"//section[@id='{section}']//h3[text()='{title}']/following-sibling::div[1]/table"
        return self.browser.find_element(By.XPATH, xpath)

    def rows(self, title, section="headline"):
        """The cells of the rows that are to be seen."""
        seen = "return [...arguments[0].tBodies[0].rows].filter((row) => row.checkVisibility()).map((row) => [...row.cells].map((cell) => cell.textContent))"
        return self.browser.execute_script(seen, self.table(title, section))

    def click(self, element):
        # Not below the filters, which stay at the top.
        self.browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
        element.click()

    def sort(self, title, name):
        self.click(self.table(title).find_element(By.XPATH, f".//th/button[text()='{name}']"))

    def tick(self, word):
        self.click(self.browser.find_element(By.CSS_SELECTOR, f".filters input[value='{word}']"))

    def complaints(self):
        """Errors of the script, and what the policy of the page forbade."""
        return [entry["message"] for entry in self.browser.get_log("browser")]


def test_a_click_on_a_columns_name_sorts_and_leaves_what_is_missing_last(browser, page):
    board, title = Board(browser, page), "Returns in the target"
    assert [(row[0], row[3]) for row in board.rows(title)[:2]] == [("three", "copies"), ("three", "resetter")]
    board.sort(title, "normalised return")
    assert [row[3] for row in board.rows(title)] == ["copies"] * 2 + ["resetter"] * 2 + ["plain"] * 2 + ["broken"]
    board.sort(title, "normalised return")
    assert [row[3] for row in board.rows(title)] == ["plain"] * 2 + ["resetter"] * 2 + ["copies"] * 2 + ["broken"]
    board.sort(title, "method")
    assert [row[3] for row in board.rows(title)] == ["broken"] + ["copies"] * 2 + ["plain"] * 2 + ["resetter"] * 2
    assert board.complaints() == []


def test_filters_hide_rows_and_change_no_figure(browser, page):
    board = Board(browser, page)
    over = "Over 2 pairs, 10 target samples, smoke"
    before = board.rows(over)
    assert [row[0] for row in before] == ["copies", "resetter", "plain"]
    board.tick("resets")
    assert board.rows(over) == [before[0], before[2]]
    assert {row[3] for row in board.rows("Returns in the target", "development")} == {"copies", "plain"}
    board.tick("transitions")
    assert board.rows(over) == [before[2]]
    board.tick("transitions")
    board.tick("resets")
    Select(browser.find_element(By.ID, "pair")).select_by_visible_text("two")
    assert {row[0] for row in board.rows("Returns in the target")} == {"two"}
    assert board.rows(over) == before
    board.tick("development")
    assert not browser.find_element(By.ID, "development").is_displayed()
    assert browser.find_element(By.ID, "headline").is_displayed()
    assert board.complaints() == []


def test_a_click_on_a_number_shows_its_runs_and_their_settings(browser, store, page):
    board = Board(browser, page)
    dialog = browser.find_element(By.TAG_NAME, "dialog")
    assert not dialog.is_displayed()
    board.click(board.table("Over 2 pairs, 10 target samples, smoke").find_element(By.CSS_SELECTOR, "tbody tr td:nth-child(3)"))
    assert dialog.is_displayed()
    assert "4 runs" in dialog.text
    assert "Settings: copies on three, smoke; copies on two, smoke\nsteps 1000\nagent.gamma 0.99" in dialog.text
    link = dialog.find_element(By.LINK_TEXT, "result.json").get_attribute("href")
    assert link == (store / "three" / "copies" / "seed0" / "result.json").as_uri()
    board.click(dialog.find_element(By.TAG_NAME, "summary"))
    assert '"normalized_return": 0.9' in dialog.text
    browser.find_element(By.ID, "close").click()
    assert not dialog.is_displayed()
    assert board.complaints() == []


@pytest.mark.parametrize("width", [1300, 500])
def test_nothing_but_tables_and_plots_is_wider_than_the_window(browser, page, width):
    Board(browser, page)
    browser.set_window_size(width, 1000)
    assert browser.execute_script("return document.documentElement.scrollWidth <= window.innerWidth")
