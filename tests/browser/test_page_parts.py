"""The page's modules, asked in the browser: numbers for people, round ticks, contours; and a long list of vehicles."""

import json
import math

import pytest

pytestmark = pytest.mark.process


@pytest.fixture
def module(visit):
    """Calls a function of one of the page's modules: `module("format.js", "fixed", 1.25, 1)`."""
    opened = visit()

    def call(name: str, function: str, *values):
        script = "([name, f, values]) => import(`/static/${name}`).then((module) => module[f](...values))"
        return opened.page.evaluate(script, [name, function, list(values)])

    return call


@pytest.mark.parametrize(
    ("mean", "deviation", "units", "text"),
    [
        (33.41234, 0.02149, "1", "33.412 ± 0.021"),
        (14.2, 0.5, "degree_Celsius", "14.20 ± 0.50 °C"),
        (-1.93, 0.11, "degree_Celsius", "−1.93 ± 0.11 °C"),
        (1234.6, 37.2, "umol kg-1", "1235 ± 37 µmol kg⁻¹"),
        (5.0, 0.0, "m s-1", "5.00 ± 0.00 m s⁻¹"),
    ],
)
def test_an_estimate_has_the_digits_that_its_deviation_leaves(module, mean, deviation, units, text):
    assert module("format.js", "estimate", mean, deviation, units) == text


@pytest.mark.parametrize(
    ("lat", "lon", "text"),
    [
        (34.041789, -118.786522, "34°02.51′N 118°47.19′W"),
        (-33.99999, 151.0, "34°00.00′S 151°00.00′E"),
        (0.0, 190.5, "0°00.00′N 169°30.00′W"),
    ],
)
def test_positions_are_degrees_and_minutes(module, lat, lon, text):
    assert module("format.js", "position", lat, lon) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(4.21, "4.2 s"), (75, "75 s"), (95, "1.6 min"), (3599, "60 min"), (8 * 3600, "8.0 h"), (3e6, "35 d")],
)
def test_durations_have_the_unit_that_suits_them(module, seconds, text):
    assert module("format.js", "duration", seconds) == text


@pytest.mark.parametrize(("low", "high"), [(33.2, 33.8), (0.0, 0.0123), (-2.1, 30.0), (1e5, 3e5)])
def test_ticks_are_round_and_within(module, low, high):
    found = module("ticks.js", "roundTicks", low, high, 5)
    step, values = found["step"], found["values"]
    mantissa = step / 10 ** math.floor(math.log10(step) + 1e-9)
    assert min(abs(mantissa - round_one) for round_one in (1, 2, 2.5, 5)) < 1e-6
    assert 3 <= len(values) <= 8
    assert low - 1e-9 * step <= values[0] <= values[-1] <= high + 1e-6 * step
    assert all(abs(value / step - round(value / step)) < 1e-6 for value in values)


def test_contours_of_a_cone_are_circles(visit):
    opened = visit()
    ends = opened.page.evaluate(
        """() => import("/static/contours.js").then(({ contour }) => {
          const values = Float32Array.from(
            { length: 2500 }, (_, i) => Math.hypot(i % 50 - 24, Math.floor(i / 50) - 26));
          const found = [];
          contour(values, 50, 50, 15, (...ends) => found.push(ends));
          return found;
        })"""
    )
    radii = [math.hypot(x - 24, y - 26) for piece in ends for x, y in (piece[:2], piece[2:])]
    # Between cells the cone's distance is not linear: a chord of one cell at this radius bends by 1 / (8 × 15).
    assert max(abs(radius - 15) for radius in radii) < 0.02
    length = sum(math.hypot(a - c, b - d) for a, b, c, d in ends)
    assert length == pytest.approx(2 * math.pi * 15, rel=0.005)


def test_a_hundred_vehicles_can_be_found(visit, browser, station):
    opened = visit()
    rows = [
        {
            "vehicle": f"boat{n:03}",
            "alive": n % 7 > 0,
            "state": "exploring",
            "reason": "",
            "variable": "salinity",
        }
        | {"units": "1", "samples": n, "lat": 34.0, "lon": -120.0, "age_s": float(n)}
        for n in range(120)
    ]
    opened.page.route("**/api/vehicles", lambda route: route.fulfill(body=json.dumps(rows)))
    nothing = {"survey": None, "model": None, "plan": None, "health": None, "track": [], "log": []}
    history = {"models": [], "series": {"utc_s": [], "rho0": None}, "plans": []}
    opened.page.route("**/api/vehicle/*", lambda route: route.fulfill(body=json.dumps(nothing)))
    opened.page.route("**/api/vehicle/*/history", lambda route: route.fulfill(body=json.dumps(history)))
    opened.page.reload()
    opened.page.locator(".fleet-item").nth(119).wait_for(state="attached")
    assert opened.page.locator(".fleet-count").inner_text() == "102 of 120 connected"
    opened.page.get_by_role("searchbox", name="Find a vehicle").fill("boat11")
    assert opened.page.locator(".fleet-item:visible").count() == 10
    assert opened.page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    assert opened.page.evaluate(
        "() => document.querySelector('.fleet').getBoundingClientRect().height <= innerHeight"
    )
