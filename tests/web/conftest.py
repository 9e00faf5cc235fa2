"""A browser, a tab of it, and page processes that follow a script."""

import pytest

from tests.web.chromium import SIZES, Chromium
from tests.web.scripted import ScriptedServer


@pytest.fixture(scope="module")
def browser():
    with Chromium() as chromium_:
        yield chromium_


@pytest.fixture
def tab(browser):
    new_tab = browser.tab()
    new_tab.size(*SIZES["laptop"])
    yield new_tab
    new_tab.close()


@pytest.fixture
def live():
    with ScriptedServer("live") as server:
        yield server


@pytest.fixture
def replay():
    with ScriptedServer("replay") as server:
        yield server
