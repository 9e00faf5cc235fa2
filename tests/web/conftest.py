"""A browser, a tab of it, and page processes that follow a script."""

import asyncio
import inspect

import pytest

from tests.web.chromium import SIZES, Chromium
from tests.web.page_client import WAIT_S
from tests.web.screens import open_page, take_lease, until
from tests.web.scripted import ScriptedServer


@pytest.fixture(scope="session")
def chromium():
    """Return the only browser of a process of the tests; starting it takes as long as a test."""
    with Chromium() as browser:
        yield browser


@pytest.fixture
def browser(chromium):
    yield chromium
    chromium.close_tabs()


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


@pytest.fixture
def driver(tab, live):
    """Return a tab that controls a driving vehicle."""
    open_page(tab, live)
    take_lease(tab)
    until(lambda: live.words("beat"))
    return tab


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem):
    """Run a test that is a coroutine in a loop of its own; pytest runs the others."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    fixtures = {name: pyfuncitem.funcargs[name] for name in pyfuncitem._fixtureinfo.argnames}
    asyncio.run(asyncio.wait_for(pyfuncitem.obj(**fixtures), 4 * WAIT_S))
    return True
