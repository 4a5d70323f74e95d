"""What people do with the page, in a real browser before a real server; the vessels are made up.

Each expectation comes from elsewhere than the page: from the vessel's own model, from the server's answers over HTTP,
or from axe-core, a checker of accessibility.
"""

import json
import os
import re
import tarfile
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from processes import wait_until
from vessels import FRAME, MadeUpVessel

pytestmark = pytest.mark.process

# Of a field that varies by 0.8: what the map's cells and the model itself say of a place differ by less.
NEAR = 1e-3
DRAWN = '.panel[data-vehicle="{}"] .surface[data-quantity="{}"]'


def asked(station, path: str):
    """What the server answers to somebody who is no browser."""
    with urllib.request.urlopen(f"{station.url}{path}", timeout=20.0) as answer:
        return json.load(answer)


def heard_of(station, vehicle: str, sequence: int) -> None:
    """Wait until the server has a vehicle's model."""

    def there() -> bool:
        try:
            model = asked(station, f"api/vehicle/{vehicle}")["model"]
        except urllib.error.HTTPError:
            return False
        return model is not None and model["sequence"] >= sequence

    wait_until(there, what=f"model {sequence} of {vehicle}")


def pointed(
    opened, vehicle: str, quantity: str, x: float, y: float, source: str = "predict"
) -> dict[str, str]:
    """What the page says of a place, given as shares of a map's width and height."""
    surface = opened.page.locator(DRAWN.format(vehicle, quantity))
    surface.scroll_into_view_if_needed()
    box = surface.bounding_box()
    opened.page.mouse.move(box["x"] + x * box["width"], box["y"] + y * box["height"])
    opened.page.locator(f'.probe[data-source="{source}"]').wait_for()
    return told(opened)


def told(opened) -> dict[str, str]:
    return opened.page.evaluate("() => ({...document.querySelector('.probe').dataset})")


def of_model(model, said: dict[str, str]) -> tuple[float, float]:
    """Mean and standard deviation that a vessel's own model gives for a place."""
    prediction = model.model.predict(FRAME.to_local([float(said["lat"])], [float(said["lon"])]))
    return float(prediction.mean[0]), float(np.sqrt(prediction.variance[0]))


def test_the_map_changes_as_the_vessel_sails(visit, station):
    with MadeUpVessel("sailor", station.endpoint) as vessel:
        vessel.sail(60)
        heard_of(station, "sailor", 1)
        opened = visit("#show=sailor")
        opened.wait_for_maps()
        before = {quantity: opened.pixels("sailor", quantity) for quantity in ("mean", "sd")}
        samples = opened.page.locator(".figures dd").first
        assert samples.inner_text() == "60"
        vessel.sail(120)
        wait_until(lambda: samples.inner_text() == "180", what="the news")
        for quantity, picture in before.items():
            wait_until(
                lambda q=quantity, p=picture: opened.pixels("sailor", q) != p, what=f"a new {quantity}"
            )


def test_the_value_under_the_pointer_is_the_models(visit, station):
    with MadeUpVessel("hoverer", station.endpoint) as vessel:
        model = vessel.sail(200)
        heard_of(station, "hoverer", 1)
        opened = visit("#show=hoverer")
        opened.wait_for_maps()
        # A share of the field's range: 1 % of a salinity of 33 would be anything.
        spread = np.ptp(vessel.truth([[x, y] for x in range(0, 12_000, 500) for y in range(0, 9_000, 500)]))
        held = []

        def hold(route) -> None:
            held.append(route)

        for x, y in ((0.3, 0.5), (0.52, 0.31), (0.7, 0.8)):
            # The server's answer is held back until the map's own value has been read.
            opened.page.mouse.move(0, 0)
            held.clear()
            opened.page.route("**/predict?*", hold)
            at_once = pointed(opened, "hoverer", "mean", x, y, "map")
            wait_until(lambda: opened.page.wait_for_timeout(20) or held, what="the question")
            for route in held:
                route.continue_()
            opened.page.unroute("**/predict?*")
            exact = pointed(opened, "hoverer", "mean", x, y, "predict")
            mean, sd = of_model(model, exact)
            for said in (at_once, exact):
                assert float(said["mean"]) == pytest.approx(mean, abs=0.01 * spread)
                assert float(said["sd"]) == pytest.approx(sd, abs=0.01 * spread)
        text = opened.page.locator(".probe").inner_text()
        assert re.fullmatch(r"3\d\.\d+ ± 0\.\d+\s+34°\d\d\.\d\d′N 120°\d\d\.\d\d′W", text)


def test_land_is_said_to_be_land(visit, station):
    with MadeUpVessel("lander", station.endpoint) as vessel:
        vessel.sail(60)
        heard_of(station, "lander", 1)
        opened = visit("#show=lander")
        opened.wait_for_maps()
        surface = opened.page.locator(DRAWN.format("lander", "sd")).bounding_box()
        opened.page.mouse.move(
            surface["x"] + 0.93 * surface["width"], surface["y"] + 0.06 * surface["height"]
        )
        value = opened.page.locator(".probe-value")
        wait_until(lambda: value.inner_text() == "land", what="land")


def test_the_slider_shows_an_older_map(visit, station):
    with MadeUpVessel("slider", station.endpoint) as vessel:
        models = [vessel.sail(60)]
        heard_of(station, "slider", 1)
        for sequence in (2, 3):
            models.append(vessel.sail(60))
            heard_of(station, "slider", sequence)
        stops = asked(station, "api/vehicle/slider/history")["models"]
        opened = visit("#show=slider")
        opened.wait_for_maps()
        newest = opened.pixels("slider")
        opened.page.locator(".slider").focus()
        opened.page.keyboard.press("Home")
        opened.page.locator('.live-button[aria-pressed="false"]').wait_for()
        opened.wait_for_maps(moment=repr(stops[0]))
        assert opened.pixels("slider") != newest
        said = pointed(opened, "slider", "mean", 0.6, 0.5)
        old, new = of_model(models[0], said), of_model(models[-1], said)
        assert float(said["mean"]) == pytest.approx(old[0], abs=NEAR)
        assert abs(old[0] - new[0]) > 1e-3
        # What comes meanwhile doesn't tear anybody out of the past.
        vessel.sail(30)
        heard_of(station, "slider", 4)
        wait_until(lambda: opened.page.locator(".slider").get_attribute("max") == "3", what="a fourth stop")
        assert told(opened)["moment"] == repr(stops[0])
        opened.page.locator(".live-button").click()
        opened.wait_for_maps(moment="now")


def test_two_vehicles_side_by_side(visit, station):
    with (
        MadeUpVessel("left", station.endpoint) as left,
        MadeUpVessel(
            "right", station.endpoint, "sea_water_temperature", "degree_Celsius", 14.2, seed=2
        ) as right,
    ):
        left.sail(90)
        right.sail(150)
        heard_of(station, "left", 1)
        heard_of(station, "right", 1)
        opened = visit("#show=left", width=1600)
        opened.wait_for_maps(2)
        opened.page.get_by_role("button", name="Show right side by side").click()
        opened.wait_for_maps(4)
        panels = [
            opened.page.locator(f'.panel[data-vehicle="{name}"]').bounding_box() for name in ("left", "right")
        ]
        assert panels[0]["x"] + panels[0]["width"] <= panels[1]["x"]
        assert panels[0]["y"] == panels[1]["y"]
        assert opened.page.locator(".panel .figures div:first-child dd").all_inner_texts() == ["90", "150"]
        assert "Temperature (°C)" in opened.page.locator(".map-unit").all_inner_texts()
        # News of both come, though the page began with one.
        left.sail(10)
        right.sail(10)
        for name, samples in (("left", "100"), ("right", "160")):
            figure = opened.page.locator(f'.panel[data-vehicle="{name}"] .figures dd').first
            wait_until(lambda f=figure, s=samples: f.inner_text() == s, what=f"news of {name}")
        assert opened.page.url.endswith("#show=left,right")
        opened.page.get_by_role("button", name="Close left").first.click()
        assert opened.page.locator(".panel h2").all_inner_texts() == ["right"]


def beyond_the_edge(opened) -> list[str]:
    """What is wider than the window, but for what scrolls or is cut on its own."""
    return opened.page.evaluate(
        """() => {
          const kept = (node) => {
            for (let up = node.parentElement; up && up !== document.body; up = up.parentElement)
              if (getComputedStyle(up).overflowX !== "visible") return true;
            return false;
          };
          const found = document.documentElement.scrollWidth > innerWidth ? ["the page"] : [];
          for (const node of document.querySelectorAll("body *")) {
            const box = node.getBoundingClientRect();
            if (box.width && (box.right > innerWidth + 0.5 || box.left < -0.5) && !kept(node) && !node.closest(".skip"))
              found.push(node.tagName + "." + node.className);
          }
          return found;
        }"""
    )


@pytest.mark.parametrize("width", [320, 360, 414, 768, 1024, 1440, 2560])
def test_no_width_makes_the_page_overflow(visit, station, width):
    name = "a-name-as-long-as-names-may-be-1"
    with MadeUpVessel(name, station.endpoint) as vessel:
        vessel.sail(90)
        heard_of(station, name, 1)
        opened = visit(f"#show={name}", width=width, height=740)
        opened.wait_for_maps()
        assert beyond_the_edge(opened) == []


def test_a_tap_on_a_phone_tells_the_value(visit, station):
    with MadeUpVessel("phone", station.endpoint) as vessel:
        model = vessel.sail(150)
        heard_of(station, "phone", 1)
        opened = visit("#show=phone", width=360, height=740, touch=True)
        opened.wait_for_maps()
        opened.page.locator(DRAWN.format("phone", "mean")).tap(position={"x": 150, "y": 130})
        opened.page.locator('.probe[data-source="predict"]').wait_for()
        said = told(opened)
        assert float(said["mean"]) == pytest.approx(of_model(model, said)[0], abs=NEAR)
        tag = opened.page.locator(".probe").bounding_box()
        assert tag["x"] >= 0
        assert tag["x"] + tag["width"] <= 360


def test_two_fingers_zoom_on_a_phone(visit, station):
    with MadeUpVessel("pinch", station.endpoint) as vessel:
        vessel.sail(90)
        heard_of(station, "pinch", 1)
        opened = visit("#show=pinch", width=360, height=740, touch=True)
        opened.wait_for_maps()
        box = opened.page.locator(DRAWN.format("pinch", "mean")).bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        hand = opened.page.context.new_cdp_session(opened.page)

        def touch(kind: str, apart: float) -> None:
            fingers = [{"x": x - apart, "y": y, "id": 0}, {"x": x + apart, "y": y, "id": 1}]
            touched = [] if kind == "touchEnd" else fingers
            hand.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touched})

        with opened.page.expect_response(finer_than(0.6 * 0.13)):
            touch("touchStart", 20.0)
            for step in range(1, 9):
                touch("touchMove", 20.0 + 10.0 * step)
            touch("touchEnd", 100.0)
        # The page itself has neither moved nor grown.
        assert opened.page.evaluate("() => [visualViewport.scale, scrollX]") == [1, 0]


def finer_than(degrees: float):
    """Whether an answer is a map of less than so many degrees of longitude."""

    def judge(answer) -> bool:
        query = urllib.parse.parse_qs(answer.url.partition("?")[2])
        return "/map?" in answer.url and float(query["east"][0]) - float(query["west"][0]) < degrees

    return judge


def test_the_history_can_be_played(visit, station):
    with MadeUpVessel("player", station.endpoint) as vessel:
        for sequence in range(1, 5):
            vessel.sail(40)
            heard_of(station, "player", sequence)
        stops = asked(station, "api/vehicle/player/history")["models"]
        opened = visit("#show=player")
        opened.wait_for_maps()
        opened.page.get_by_role("button", name="Play the history").click()
        opened.page.locator('.live-button[aria-pressed="false"]').wait_for()
        # It ends with what is now, having asked for what was.
        opened.page.locator('.live-button[aria-pressed="true"]').wait_for()
        opened.page.get_by_role("button", name="Play the history").wait_for()
        opened.wait_for_maps(moment="now")
        assert any(f"at={stop!r}" in url for stop in stops[:-1] for url in opened.addresses)


def luminance(opened) -> float:
    red, green, blue = map(
        int,
        re.findall(r"\d+", opened.page.evaluate("() => getComputedStyle(document.body).backgroundColor"))[:3],
    )
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def test_dark_and_light(visit, station):
    with MadeUpVessel("owl", station.endpoint) as vessel:
        vessel.sail(60)
        heard_of(station, "owl", 1)
        opened = visit("#show=owl", scheme="dark")
        opened.wait_for_maps()
        assert luminance(opened) < 30
        night = opened.pixels("owl")
        opened.page.get_by_role("button", name="Switch to the light theme").click()
        assert luminance(opened) > 220
        # The frame of the map follows.
        wait_until(lambda: opened.pixels("owl") != night, what="a light map")
        opened.page.reload()
        opened.wait_for_maps()
        assert luminance(opened) > 220


def test_keys_move_the_map_and_read_out_its_middle(visit, station):
    with MadeUpVessel("keys", station.endpoint) as vessel:
        model = vessel.sail(150)
        heard_of(station, "keys", 1)
        opened = visit("#show=keys")
        opened.wait_for_maps()
        opened.page.locator(DRAWN.format("keys", "mean")).focus()
        whole = opened.pixels("keys")
        for key in ("+", "+", "ArrowLeft", "ArrowUp"):
            opened.page.keyboard.press(key)
        spoken = opened.page.locator("[aria-live=polite]")
        wait_until(lambda: " at 34°" in (spoken.text_content() or ""), what="the read-out")
        said = told(opened)
        assert float(said["mean"]) == pytest.approx(of_model(model, said)[0], abs=NEAR)
        assert opened.pixels("keys") != whole
        opened.page.keyboard.press("0")
        opened.page.keyboard.press("Escape")
        wait_until(lambda: opened.pixels("keys") == whole, what="the whole survey again")


def test_zooming_asks_for_finer_cells(visit, station):
    with MadeUpVessel("lens", station.endpoint) as vessel:
        model = vessel.sail(200)
        heard_of(station, "lens", 1)
        opened = visit("#show=lens")
        opened.wait_for_maps()
        box = opened.page.locator(DRAWN.format("lens", "mean")).bounding_box()
        opened.page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 0.5 * box["height"])
        with opened.page.expect_response(finer_than(0.3 * 0.13)):
            for _ in range(6):
                opened.page.mouse.wheel(0, -300)
        said = pointed(opened, "lens", "mean", 0.41, 0.52)
        assert float(said["mean"]) == pytest.approx(of_model(model, said)[0], abs=NEAR)


def test_states_that_are_not_the_usual_one_are_said(visit, station):
    with MadeUpVessel("newcomer", station.endpoint) as vessel:
        vessel.tell_nothing_but_presence()
        wait_until(lambda: any(v["vehicle"] == "newcomer" for v in asked(station, "api/vehicles")))
        opened = visit("#show=newcomer")
        notice = opened.page.locator(".map-notice").first
        wait_until(lambda: notice.inner_text().startswith("No data yet"), what="no data yet")
        vessel.sail(60)
        opened.wait_for_maps()
        assert notice.is_hidden()
    alert = opened.page.locator(".alert")
    wait_until(
        lambda: alert.inner_text().startswith("Link lost: nothing from newcomer for"), what="link lost"
    )
    row = opened.page.locator(".fleet-item", has_text="newcomer")
    wait_until(lambda: "link lost" in row.inner_text().lower(), what="the list")


def test_what_a_vehicle_says_is_text(visit, station):
    with MadeUpVessel("markup", station.endpoint) as vessel:
        vessel.sail(60)
        heard_of(station, "markup", 1)
        opened = visit("#show=markup")
        opened.wait_for_maps()
        line = opened.page.locator(".line span").first
        wait_until(lambda: "<b>4</b>" in line.inner_text(), what="the log line")


def axe_source() -> str:
    """The checker's text, from the archive that `npm pack axe-core` makes."""
    folder = Path(os.environ.get("HALOCLINE_AXE", Path(__file__).parents[2] / ".venv"))
    archives = sorted(folder.glob("axe-core-*.tgz"))
    if not archives:
        pytest.skip(f"no axe-core in {folder}: make browser-test fetches it")
    with tarfile.open(archives[-1]) as archive:
        member = archive.extractfile("package/axe.min.js")
        assert member is not None
        return member.read().decode()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [360, 1600])
def test_axe_finds_nothing(visit, station, scheme, width):
    axe = axe_source()
    with (
        MadeUpVessel("able", station.endpoint) as vessel,
        MadeUpVessel("baker", station.endpoint, seed=1) as other,
    ):
        vessel.sail(90)
        other.sail(90)
        heard_of(station, "able", 1)
        heard_of(station, "baker", 1)
        opened = visit("#show=able,baker", width=width, scheme=scheme)
        opened.wait_for_maps(4)
        opened.page.evaluate(f"{axe}; 0")
        found = opened.page.evaluate("() => axe.run()")
        assert [
            (each["impact"], each["id"], each["nodes"][0]["target"]) for each in found["violations"]
        ] == []
        assert len(found["passes"]) > 30


def test_nothing_is_asked_of_another_machine(visit, station, outside):
    with MadeUpVessel("hermit", station.endpoint) as vessel:
        vessel.sail(60)
        heard_of(station, "hermit", 1)
        opened = visit("#show=hermit")
        opened.wait_for_maps()
        pointed(opened, "hermit", "sd", 0.4, 0.4)
        assert {url.split("/")[2] for url in opened.addresses} == {station.http}
    assert outside.asked == []
