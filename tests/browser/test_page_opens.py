"""The short form: the page opens in a real browser, draws its maps, and complains of nothing."""

import pytest
from vessels import MadeUpVessel

pytestmark = [pytest.mark.process, pytest.mark.short]


def test_the_page_opens_and_draws_both_maps(visit, station, outside):
    with MadeUpVessel("otter", station.endpoint) as vessel:
        vessel.sail(150)
        opened = visit()
        opened.wait_for_maps(2)
        assert opened.page.locator(".panel h2").inner_text() == "otter"
        # A canvas of one colour would be drawn, too.
        assert len(opened.pixels("otter")) > 20_000
        assert {url.split("/")[2] for url in opened.addresses} == {station.http}
    assert outside.asked == []
