"""The server goes, and comes back: the page says so, and goes on by itself."""

import pytest
from processes import wait_until
from vessels import MadeUpVessel

pytestmark = pytest.mark.process


def test_the_page_outlives_its_server(visit, station):
    with MadeUpVessel("patient", station.endpoint) as vessel:
        vessel.sail(60)
        opened = visit("#show=patient")
        opened.wait_for_maps()
        state = opened.page.locator("#server")
        assert state.inner_text() == "Live"
        station.process.stop()
        wait_until(lambda: state.inner_text().startswith("Server gone for"), what="the server's going seen")
        station.start()
        wait_until(lambda: state.inner_text() == "Live", what="the line again")
        vessel.sail(30)
        samples = opened.page.locator(".figures dd").first
        wait_until(lambda: samples.inner_text() == "90", what="news from the new server")
    # A browser itself complains of each refused connection; nothing else may.
    assert all("ERR_CONNECTION_REFUSED" in each or "WebSocket" in each for each in opened.complaints)
    opened.complaints.clear()
