"""The server's answers: shapes, maps and values against the model, refusals, and who is let in."""

import asyncio
import json
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from aiohttp import WSMsgType, WSServerHandshakeError
from aiohttp.test_utils import TestClient, TestServer

from autonomy import wire
from autonomy.config.private import PrivateFileError
from autonomy.geometry import LocalFrame
from autonomy.shore.serve_cli import LOOPBACK
from autonomy.shore.server import atelier, connections
from autonomy.shore.server.access import check_token, read_token
from autonomy.shore.server.application import Parts, application
from autonomy.shore.server.atelier import Atelier
from autonomy.shore.server.connections import Connections
from autonomy.shore.server.fleet import Fleet
from autonomy.shore.server.guards import check_names
from autonomy.shore.server.live import Live
from autonomy.shore.server.nowcasts import Nowcasts
from autonomy.shore.server.state import Lag
from autonomy.shore.subscriber import Counters, Presence, Update
from autonomy.wire import LogBatch, LogNotice, ObservationBatch, ObservationNotice

sys.path.insert(0, str(Path(__file__).parents[2] / "process"))
from shore_helpers import (
    health_notice,
    learnt_model,
    model_snapshot,
    observation,
    plan_notice,
    survey_notice,
)

TOKEN = "correct-horse-battery-staple"
UTC_S = 1.7e9


@pytest.fixture(scope="module")
def snapshots():
    """Two models of different fields, as they come over the wire."""
    made = [model_snapshot(learnt_model(seed)[0], sequence=10 * seed) for seed in (0, 1)]
    return [(wire.decode(wire.Topic.MODEL, payload), payload) for payload in map(wire.encode, made)]


def take(fleet, value, payload=None, at_s=UTC_S, vehicle="boat1"):
    fleet.take(Update(vehicle, value), payload, at_s)


def filled(snapshots, fleet):
    take(fleet, Presence(True))
    for snapshot, payload in snapshots:
        take(fleet, snapshot, payload, UTC_S + 1.0)
    take(fleet, survey_notice())
    take(fleet, plan_notice(), at_s=UTC_S + 2.0)
    take(fleet, health_notice("on the way"), at_s=UTC_S + 3.0)
    readings = (observation(0), replace(observation(1), value=float("nan"), flag=9))
    take(fleet, ObservationBatch(1, 0, 0, 2, readings))
    take(fleet, LogBatch(1, 0, 0, 1, (LogNotice("warning", "shallow"),)), at_s=UTC_S + 4.0)


def asked(scenario, fleet=None, middlewares=(), page=None):
    """Run `scenario(client)` against the application."""

    async def run():
        vehicles = Fleet() if fleet is None else fleet
        kept = Atelier()
        more = {} if page is None else {"page": page}
        parts = Parts(
            vehicles, Live(vehicles), Nowcasts(vehicles, kept), Lag(), lambda: Counters(7, 2, 1), **more
        )
        app = application(parts, *middlewares)
        try:
            async with TestClient(TestServer(app)) as client:
                return await scenario(client)
        finally:
            kept.close()

    return asyncio.run(asyncio.wait_for(run(), 60))


@pytest.fixture
def fleet(snapshots):
    made = Fleet()
    filled(snapshots, made)
    return made


def answers(fleet, *paths):
    """Status, headers and body of each."""

    async def scenario(client):
        found = []
        for path in paths:
            async with client.get(path) as answer:
                found.append((answer.status, answer.headers, await answer.read()))
        return found

    return asked(scenario, fleet)


def test_the_list_of_vehicles(fleet):
    take(fleet, Presence(False), vehicle="another")
    [(status, _, body)] = answers(fleet, "/api/vehicles")
    assert status == 200
    another, boat = json.loads(body)
    assert another["vehicle"] == "another"
    assert not another["alive"]
    assert another["state"] is None
    age_s = boat.pop("age_s")
    assert age_s > 0
    assert boat == {
        "vehicle": "boat1",
        "alive": True,
        "state": "EXPLORING",
        "reason": "on the way",
        "variable": "sea_water_practical_salinity",
        "units": "1",
        "samples": 400,
        "lat": 34.41,
        "lon": -120.49,
    }


def test_everything_of_a_vehicle(fleet, snapshots):
    [(status, _, body)] = answers(fleet, "/api/vehicle/boat1")
    assert status == 200
    latest = json.loads(body)
    assert sorted(latest) == ["alive", "health", "log", "model", "plan", "survey", "track", "vehicle"]
    snapshot = snapshots[1][0]
    assert latest["model"]["sequence"] == snapshot.sequence == 10
    assert latest["model"]["kernel"] == [
        {
            "variance": 0.5,
            "space": "squared_exponential",
            "lengthscales_m": [1500.0, 1200.0],
            "time": "static",
            "timescale_s": None,  # infinite
        }
    ]
    frame = LocalFrame(snapshot.origin_lat_deg, snapshot.origin_lon_deg)
    np.testing.assert_allclose(latest["model"]["basis"], frame.to_geodetic(snapshot.model.basis), atol=1e-7)
    assert latest["survey"]["land"] == [[list(corner) for corner in survey_notice().land[0]]]
    assert latest["survey"]["bounds"] == {"south": 34.4, "west": -120.5, "north": 34.48, "east": -120.37}
    assert latest["plan"]["route_deg"] == [list(corner) for corner in plan_notice().route_deg]
    assert latest["health"]["quality"] == {"aggregate": [400, 0, 2, 1, 0]}
    assert latest["track"] == [[0.0, 34.4, -120.5, 33.0, 1.0], [1.0, 34.4001, -120.5, None, 9.0]]
    assert latest["log"] == [{"utc_s": UTC_S + 4.0, "level": "warning", "text": "shallow"}]


def test_a_vehicle_that_has_said_nothing_yet():
    fleet = Fleet()
    take(fleet, Presence(True))
    (all_of_it, history, map_), _ = (answers(fleet, *paths) for paths in (PATHS, ()))
    assert json.loads(all_of_it[2])["model"] is None
    assert json.loads(history[2])["models"] == []
    assert map_[0] == 503
    assert map_[2] == b"boat1 has not published a model yet\n"
    assert int(map_[1]["Retry-After"]) > 0


PATHS = ("/api/vehicle/boat1", "/api/vehicle/boat1/history", "/api/vehicle/boat1/map")


def test_the_history_has_the_stops_of_the_slider(fleet):
    [(_, _, body)] = answers(fleet, "/api/vehicle/boat1/history")
    history = json.loads(body)
    assert history["models"] == history["series"]["utc_s"] == [UTC_S, UTC_S + 10.0]
    assert history["series"]["model_time_s"] == [1000.0, 1010.0]
    assert history["series"]["basis_size"] == [60.0, 60.0]
    assert history["series"]["lengthscales_m"] == [[1500.0, 1200.0]] * 2
    assert history["series"]["rho0"] == 0.6
    assert [plan["mutual_information"] for plan in history["plans"]] == [4.5]


QUERY = "south=34.41&west=-120.48&north=34.47&east=-120.4&rows=60&columns=80"


def field_map(answer, rows=60, columns=80):
    status, _, body = answer
    assert status == 200
    return np.frombuffer(body, dtype="<f4").reshape(2, rows, columns)


def truth(snapshot, rows=60, columns=80):
    lat = 34.47 - (np.arange(rows) + 0.5) * 0.06 / rows
    lon = -120.48 + (np.arange(columns) + 0.5) * 0.08 / columns
    frame = LocalFrame(snapshot.origin_lat_deg, snapshot.origin_lon_deg)
    local = frame.to_local(*np.meshgrid(lat, lon, indexing="ij"))
    prediction = snapshot.model.predict(local.reshape(-1, 2))
    return prediction.mean.reshape(rows, columns), np.sqrt(prediction.variance).reshape(rows, columns)


def test_a_map_is_the_models_own(fleet, snapshots):
    before, after = answers(
        fleet, f"/api/vehicle/boat1/map?at={UTC_S + 9}&{QUERY}", f"/api/vehicle/boat1/map?at=now&{QUERY}"
    )
    for answer, (snapshot, _) in zip((before, after), snapshots, strict=True):
        mean, sd = field_map(answer)
        known = np.isfinite(mean)
        # The island of survey_notice: half of a square of a hundredth of a degree, in a map of 0.06 by 0.08.
        assert (~known).mean() == pytest.approx(0.5 * 1e-4 / (0.06 * 0.08), rel=0.1)
        expected_mean, expected_sd = truth(snapshot)
        np.testing.assert_allclose(mean[known], expected_mean[known], atol=1e-5)
        np.testing.assert_allclose(sd[known], expected_sd[known], rtol=1e-3)
        assert int(answer[1]["X-Sequence"]) == snapshot.sequence
        assert float(answer[1]["X-Utc"]) == snapshot.utc_s
        low, high = map(float, answer[1]["X-Mean-Range"].split())
        assert (low, high) == pytest.approx((mean[known].min(), mean[known].max()))


def test_a_model_that_comes_while_its_clock_went_back_is_now(fleet, snapshots):
    snapshot, _ = snapshots[0]
    earlier = replace(snapshot, sequence=77, utc_s=UTC_S - 500.0)
    take(fleet, earlier, wire.encode(earlier))
    [(_, headers, _)] = answers(fleet, f"/api/vehicle/boat1/map?{QUERY}")
    assert headers["X-Sequence"] == "77"


def test_values_at_a_place(fleet, snapshots):
    path = "/api/vehicle/boat1/predict?lat=34.45&lon=-120.42"
    (_, _, now), (_, _, then), (_, _, ashore), (_, _, away) = answers(
        fleet,
        path,
        f"{path}&at={UTC_S}",
        "/api/vehicle/boat1/predict?lat=34.4345&lon=-120.4415",
        "/api/vehicle/boat1/predict?lat=0&lon=0",
    )
    for body, (snapshot, _) in ((now, snapshots[1]), (then, snapshots[0])):
        value = json.loads(body)
        frame = LocalFrame(snapshot.origin_lat_deg, snapshot.origin_lon_deg)
        prediction = snapshot.model.predict(frame.to_local([34.45], [-120.42]))
        assert value["mean"] == pytest.approx(prediction.mean[0], rel=1e-12)
        assert value["sd"] == pytest.approx(np.sqrt(prediction.variance[0]), rel=1e-9)
        assert value["units"] == "1"
        assert (value["land"], value["outside"]) == (False, False)
    # Where the map has no value there is none to be had singly.
    names = ("mean", "sd", "land", "outside")
    assert [json.loads(ashore)[name] for name in names] == [None, None, True, False]
    assert [json.loads(away)[name] for name in names] == [None, None, False, True]


@pytest.mark.parametrize(
    ("path", "status", "words"),
    [
        ("/api/vehicle/boat1/map?rows=0", 400, "rows: must be a whole number from 1 to 2000"),
        ("/api/vehicle/boat1/map?rows=-5", 400, "rows"),
        ("/api/vehicle/boat1/map?rows=1e3", 400, "rows"),
        ("/api/vehicle/boat1/map?rows=%D9%A3", 400, "rows"),
        ("/api/vehicle/boat1/map?rows=9999999999999999999999999", 400, "rows"),
        ("/api/vehicle/boat1/map?rows=2000&columns=2000", 400, "at most 1000000 cells in all, not 4000000"),
        ("/api/vehicle/boat1/map?south=nan", 400, "south: must be a number from -90 to 90"),
        ("/api/vehicle/boat1/map?south=1e999", 400, "south"),
        ("/api/vehicle/boat1/map?south=40&north=30", 400, "south must be below north"),
        ("/api/vehicle/boat1/map?west=0&east=170", 400, "west below east, by 30 degrees at most"),
        ("/api/vehicle/boat1/map?at=yesterday", 400, "at: must be a number from 0 to 1e+11"),
        ("/api/vehicle/boat1/map?depth=3", 400, "'depth': not a parameter of this; there are at, south"),
        ("/api/vehicle/boat1/map?rows=3&rows=4", 400, "rows: given more than once"),
        ("/api/vehicle/boat1/predict?lat=34", 400, "lon: is missing"),
        ("/api/vehicle/boat1/predict?lat=34&lon=abc", 400, "lon: must be a number from -180 to 360"),
        ("/api/vehicle/boat9", 404, "boat9 has not been heard of"),
        ("/api/vehicle/boat9/map", 404, "boat9 has not been heard of"),
        ("/api/vehicle/boat%2a", 400, "vehicle: must match"),
        ("/api/vehicle/" + "x" * 33, 400, "vehicle: must match"),
        ("/api/vehicles?x=" + "y" * 7000, 400, "not a parameter of this; there are none"),
        ("/api/live?vehicles=a,b%20c", 400, "vehicle: must match"),
        ("/api/live?vehicles=" + "a," * 65, 400, "vehicles: at most 64"),
        ("/nothing", 404, "Not Found"),
        ("/static/../fleet.py", 404, ""),
        ("/static/%2e%2e/server/fleet.py", 404, "no such file"),
        ("/static/vendor", 404, "no such file"),
        ("/static//etc/passwd", 404, "no such file"),
        ("/static/app%00.js", 404, "no such file"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_what_would_be_right(fleet, path, status, words):
    from yarl import URL

    [(got, headers, body)] = answers(fleet, URL(path, encoded=True))
    assert got == status
    assert words in body.decode()
    assert "Content-Security-Policy" in headers


def test_other_methods_are_refused(fleet):
    async def scenario(client):
        for method in ("POST", "PUT", "DELETE", "OPTIONS", "PATCH"):
            async with client.request(method, "/api/vehicles", data=b"x" * 100_000) as answer:
                assert answer.status in (405, 413)

    asked(scenario, fleet)


def test_heads_have_no_bodies(fleet):
    async def scenario(client):
        for path in ("/api/vehicles", "/api/vehicle/boat1/map?rows=300&columns=300"):
            async with client.head(path) as answer:
                assert (answer.status, await answer.read()) == (200, b"")
            # The connection is fit for another request.
            async with client.get("/api/vehicles") as answer:
                assert len(await answer.json()) == 1

    asked(scenario, fleet)


def test_the_page_and_its_files(tmp_path):
    (tmp_path / "index.html").write_text("<!doctype html>page")
    (tmp_path / "vendor").mkdir()
    (tmp_path / "vendor" / "plot.js").write_text("export {}")
    (tmp_path.parent / "secret").write_text("secret")
    (tmp_path / "link.js").symlink_to(tmp_path.parent / "secret")
    (tmp_path / "passwords").write_text("of no kind that a page is made of")

    async def scenario(client):
        async with client.get("/") as answer:
            assert (answer.status, answer.content_type) == (200, "text/html")
            assert "page" in await answer.text()
        async with client.get("/static/vendor/plot.js") as answer:
            # Browsers run modules only under this type.
            assert (answer.status, answer.content_type) == (200, "text/javascript")
            again = answer.headers["ETag"]
        async with client.get("/static/vendor/plot.js", headers={"If-None-Match": again}) as answer:
            assert answer.status == 304
        for name in ("link.js", "passwords"):
            async with client.get(f"/static/{name}") as answer:
                assert answer.status == 404

    asked(scenario, page=tmp_path)


def test_headers_let_the_browser_load_nothing_from_elsewhere(fleet):
    for _, headers, _ in answers(fleet, "/", "/api/vehicles", "/api/vehicle/boat1/map", "/nothing"):
        policy = dict(each.strip().split(" ", 1) for each in headers["Content-Security-Policy"].split(";"))
        assert policy["default-src"] == "'self'"
        assert policy["frame-ancestors"] == policy["base-uri"] == policy["object-src"] == "'none'"
        assert not any(word in headers["Content-Security-Policy"] for word in ("unsafe", "*", "http"))
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Referrer-Policy"] == "no-referrer"
        assert not any(name.lower().startswith("access-control") for name in headers)
        assert "aiohttp" not in headers.get("Server", "")


def test_colour_maps_are_those_of_cmocean(fleet):
    [(_, headers, body)] = answers(fleet, "/api/colormaps")
    tables = json.loads(body)
    assert {"haline", "thermal", "viridis"} <= set(tables)
    assert all(np.shape(table) == (256, 3) for table in tables.values())
    assert tables["haline"][0] == [42, 24, 108]  # the first line of haline-rgb.txt × 255
    assert tables["viridis"][0] == [68, 1, 84]
    assert tables["viridis"][-1] == [253, 231, 37]
    assert "max-age" in headers["Cache-Control"]


def test_the_server_says_how_it_is(fleet):
    [(_, _, body)] = answers(fleet, "/api/server")
    state = json.loads(body)
    assert state["vehicles"] == 1
    assert (state["received"], state["refused"], state["dropped"]) == (7, 2, 1)
    assert state["lag_s"] >= 0.0
    assert 20.0 < state["memory_mb"] < 5000.0
    assert state["clients"] == 0
    assert state["recording"] is None


def status_of(headers, names=LOOPBACK, path="/api/vehicles"):
    async def scenario(client):
        async with client.get(path, headers=headers) as answer:
            return answer.status

    return asked(scenario, middlewares=[check_names(names)])


@pytest.mark.parametrize(
    "host", ["localhost", "localhost:8080", "127.0.0.1:1", "[::1]:8080", "[::1]", "LOCALHOST"]
)
def test_on_loopback_it_is_called_by_the_names_of_loopback(host):
    assert status_of({"Host": host}) == 200


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8080", "localhost.evil.example", "127.0.0.1.nip.io", "[", ""]
)
def test_a_name_that_somebody_made_lead_here_is_refused(host):
    assert status_of({"Host": host}) in (400, 403)


def test_a_server_that_does_not_know_its_names_answers_to_any():
    assert status_of({"Host": "survey.example:8080"}, names=None) == 200


@pytest.mark.parametrize(
    ("origin", "status"),
    [("http://localhost:80", 200), ("http://evil.example", 403), ("null", 403), ("http://localhost:81", 403)],
)
def test_pages_of_others_are_refused(origin, status):
    assert status_of({"Host": "localhost:80", "Origin": origin}) == status


def test_a_page_of_another_cannot_follow_the_news():
    async def scenario(client):
        with pytest.raises(WSServerHandshakeError, match="403"):
            await client.ws_connect("/api/live", headers={"Origin": "http://evil.example"})
        own = f"http://127.0.0.1:{client.port}"
        async with client.ws_connect("/api/live", headers={"Origin": own}) as socket:
            assert not socket.closed

    asked(scenario, middlewares=[check_names(LOOPBACK)])


def test_pages_are_taken_leave_of():
    async def scenario(client):
        sockets = [await client.ws_connect("/api/live") for _ in range(3)]
        stopping = asyncio.create_task(client.app.shutdown())
        for socket in sockets:
            while (await socket.receive()).type is WSMsgType.TEXT:
                pass
            assert socket.close_code == 1001
        await stopping

    asked(scenario)


def test_who_does_not_know_the_token_sees_nothing(fleet):
    async def scenario(client):
        for path in ("/api/vehicles", "/api/vehicle/boat1", "/api/server", "/static/app.js", "/nothing"):
            async with client.get(path) as answer:
                assert answer.status == 401
                assert answer.headers["WWW-Authenticate"] == "Bearer"
        for header in (
            "Bearer wrong",
            f"Basic {TOKEN}",
            TOKEN,
            "Bearer ",
            f"Bearer {TOKEN[:-1]}",
            "Bearer \xff",
        ):
            async with client.get("/api/vehicles", headers={"Authorization": header}) as answer:
                assert answer.status == 401
        with pytest.raises(WSServerHandshakeError, match="401"):
            await client.ws_connect("/api/live")
        async with client.get("/", allow_redirects=False) as answer:
            assert (answer.status, answer.headers["Location"]) == (303, "/login")

    asked(scenario, fleet, [check_token(TOKEN)])


def test_a_program_shows_the_token_in_a_header(fleet):
    async def scenario(client):
        headers = {"Authorization": f"Bearer {TOKEN}"}
        async with client.get("/api/vehicles", headers=headers) as answer:
            assert answer.status == 200

    asked(scenario, fleet, [check_token(TOKEN)])


def test_a_browser_logs_in_and_has_a_cookie(fleet):
    async def scenario(client):
        async with client.get("/login") as answer:
            assert answer.content_type == "text/html"
            assert "<script" not in (text := await answer.text())
            assert "style=" not in text
        async with client.get("/login.css") as answer:
            assert answer.content_type == "text/css"
        async with client.post("/login", data={"token": "wrong"}, allow_redirects=False) as answer:
            assert answer.status == 403
            assert "Set-Cookie" not in answer.headers
        async with client.post("/login", data={"token": TOKEN}, allow_redirects=False) as answer:
            assert (answer.status, answer.headers["Location"]) == (303, "/")
            cookie = answer.headers["Set-Cookie"]
        assert all(word in cookie for word in ("HttpOnly", "SameSite=Strict"))
        # What the browser keeps lets nobody in as a program.
        assert TOKEN not in cookie
        value = cookie.partition("=")[2].partition(";")[0]
        async with client.get("/api/vehicles", headers={"Authorization": f"Bearer {value}"}) as answer:
            assert answer.status == 200  # by the cookie, which the client has kept
        client.session.cookie_jar.clear()
        async with client.get("/api/vehicles", headers={"Authorization": f"Bearer {value}"}) as answer:
            assert answer.status == 401
        async with client.get("/api/vehicles", headers={"Cookie": f"halocline={value}"}) as answer:
            assert answer.status == 200
        async with client.post("/login", data={"token": "x" * 100_000}, allow_redirects=False) as answer:
            assert answer.status == 413

    asked(scenario, fleet, [check_token(TOKEN)])


def test_a_token_is_in_a_private_file_and_long_enough(tmp_path):
    file = tmp_path / "token"
    file.write_text(TOKEN + "\n")
    file.chmod(0o600)
    assert read_token(file) == TOKEN
    file.chmod(0o644)
    with pytest.raises(PrivateFileError, match="others may read"):
        read_token(file)
    for text in ("short", "with spaces in between them", "ümläute-sind-keine-buchstaben", ""):
        file.write_text(text)
        file.chmod(0o600)
        with pytest.raises(PrivateFileError, match="at least 16"):
            read_token(file)


def test_maps_are_made_once_for_all_who_ask(fleet, monkeypatch):
    from autonomy.shore.server import nowcasts

    made, may = [], threading.Event()
    evaluate = nowcasts.evaluate

    def slow(*arguments):
        made.append(arguments)
        assert may.wait(30.0)
        return evaluate(*arguments)

    monkeypatch.setattr(nowcasts, "evaluate", slow)

    async def scenario(client):
        async def ask():
            async with client.get(f"/api/vehicle/boat1/map?{QUERY}") as answer:
                return await answer.read()

        asking = [asyncio.create_task(ask()) for _ in range(5)]
        gone = asyncio.create_task(ask())
        while not made:
            await asyncio.sleep(0.01)
        gone.cancel()
        may.set()
        bodies = await asyncio.gather(*asking)
        assert len(set(bodies)) == 1
        assert await ask() == bodies[0]
        assert len(made) == 1

    asked(scenario, fleet)


def test_who_asks_for_too_much_at_once_is_put_off(fleet, monkeypatch):
    from autonomy.shore.server import nowcasts

    monkeypatch.setattr(atelier, "_MAXIMUM_WAITING", 3)
    may = threading.Event()
    evaluate = nowcasts.evaluate
    monkeypatch.setattr(nowcasts, "evaluate", lambda *arguments: may.wait(30.0) and evaluate(*arguments))

    async def scenario(client):
        async def ask(rows):
            async with client.get(f"/api/vehicle/boat1/map?rows={rows}") as answer:
                return answer.status

        asking = [asyncio.create_task(ask(rows)) for rows in range(2, 8)]
        await asyncio.wait(asking, return_when=asyncio.FIRST_COMPLETED)
        may.set()
        statuses = await asyncio.gather(*asking)
        assert set(statuses) == {200, 503}
        # The others still have answers meanwhile and afterwards.
        assert await ask(9) == 200

    asked(scenario, fleet)


def test_what_is_kept_of_maps_stays_within_bounds():
    async def run():
        kept = Atelier(maximum_bytes=1000)
        for number in range(50):
            assert await kept.make(number, lambda number=number: number, lambda _: 300) == number
        calls = []
        for number in (49, 48, 47, 46):
            await kept.make(number, lambda: calls.append(1), lambda _: 300)
        assert len(calls) == 1
        with pytest.raises(ZeroDivisionError):
            await kept.make("broken", lambda: 1 // 0, lambda _: 1)
        assert await kept.make("broken", lambda: "mended", lambda _: 1) == "mended"
        kept.close()

    asyncio.run(run())


def test_a_head_that_never_ends_is_not_waited_for(fleet, monkeypatch):
    monkeypatch.setattr(connections, "_LOOK_S", 0.05)
    guard = Connections(first_s=0.3, next_s=0.6)

    async def scenario(client):
        watching = asyncio.create_task(guard.watch(client.server.runner.server))
        reader, writer = await asyncio.open_connection(client.host, client.port)
        writer.write(b"GET /api/vehicles HTTP/1.1\r\nHost: x\r\nX-Slow: ")
        follower = await client.ws_connect("/api/live")
        # It is hung up on while it still sends.
        with pytest.raises((ConnectionError, asyncio.IncompleteReadError)):  # noqa: PT012
            while True:
                writer.write(b"y")
                await writer.drain()
                await asyncio.sleep(0.02)
                if reader.at_eof():
                    raise ConnectionResetError
        async with client.get("/api/vehicles") as answer:
            assert answer.status == 200
        # The news go on for as long as they are wanted.
        assert not follower.closed
        await follower.ping()
        watching.cancel()
        writer.close()

    asked(scenario, fleet, [guard.middleware()])


def test_there_are_only_so_many_connections(fleet, monkeypatch):
    monkeypatch.setattr(connections, "_LOOK_S", 0.05)
    monkeypatch.setattr(connections, "MAXIMUM_CONNECTIONS", 10)
    guard = Connections()

    async def scenario(client):
        server = client.server.runner.server
        watching = asyncio.create_task(guard.watch(server))
        opened = [await asyncio.open_connection(client.host, client.port) for _ in range(40)]
        while len(server.connections) > 10:
            await asyncio.sleep(0.01)
        for _, writer in opened:
            writer.close()
        while server.connections:
            await asyncio.sleep(0.01)
        async with client.get("/api/vehicles") as answer:
            assert answer.status == 200
        watching.cancel()

    asked(scenario, fleet, [guard.middleware()])


def test_maps_that_nobody_reads_do_not_fill_the_memory(fleet, monkeypatch):
    monkeypatch.setattr("autonomy.shore.server.application._UNREAD_BYTES", 20_000_000)
    path = "/api/vehicle/boat1/map?rows=1000&columns=1000"  # 8 MB each: two find room

    async def scenario(client):
        deaf = [await asyncio.open_connection(client.host, client.port, limit=1024) for _ in range(10)]
        refused = 0
        for stream, writer in deaf:
            writer.write(f"GET {path} HTTP/1.1\r\nHost: x\r\n\r\n".encode())
            head = await stream.readuntil(b"\r\n\r\n")
            refused += b" 503 " in head
        assert refused == 8
        for _, writer in deaf:
            writer.transport.abort()
        for _ in range(1000):
            async with client.get(path) as answer:
                if answer.status == 200:
                    assert len(await answer.read()) == 8_000_000
                    return
            await asyncio.sleep(0.01)
        raise AssertionError("what was taken for those who have gone is not given back")

    asked(scenario, fleet)


def test_ten_thousand_names_do_not_push_out_who_is_there(snapshots):
    fleet = Fleet(history_bytes=2**20)
    filled(snapshots, fleet)
    for number in range(10_000):
        take(fleet, health_notice(), vehicle=f"ghost{number}")
    assert len(fleet) == 256
    assert fleet.everything("boat1")["alive"]
    # Those who are really there take the places of ghosts.
    for number in range(20):
        take(fleet, Presence(True), vehicle=f"real{number}")
    names = [each["vehicle"] for each in fleet.summaries()]
    assert len(names) == 256
    assert {"boat1", *(f"real{number}" for number in range(20))} <= set(names)


def test_what_a_vehicle_tells_again_is_not_taken_again():
    fleet, told = Fleet(), []
    fleet.tell(told.append)

    def tell(run, first, end):
        numbers = range(first, end)
        lines = tuple(LogNotice("info", f"{run}.{number}") for number in numbers)
        take(fleet, ObservationBatch(run, first, 0, end, tuple(map(observation, numbers))))
        take(fleet, LogBatch(run, first, 0, end, lines))

    # In pieces that overlap, wholly and in part; the numbers of another run are other numbers.
    for piece in ((7, 0, 3), (7, 0, 3), (7, 1, 5), (7, 2, 4), (7, 5, 6), (3, 0, 2)):
        tell(*piece)
    latest = fleet.everything("boat1")
    assert [row[0] for row in latest["track"]] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 0.0, 1.0]
    assert [line["text"] for line in latest["log"]] == [
        "7.0",
        "7.1",
        "7.2",
        "7.3",
        "7.4",
        "7.5",
        "3.0",
        "3.1",
    ]
    # Nor is any page told again.
    assert [line.data["text"] for line in told if line.kind == "log"] == [
        line["text"] for line in latest["log"]
    ]
    assert sum(len(each.data) for each in told if each.kind == "observations") == 8
    assert all(each.data for each in told)


def test_a_log_of_long_lines_and_readings_without_end_stay_small():
    fleet = Fleet()
    for number in range(3000):
        take(fleet, LogBatch(1, number, 0, number + 1, (LogNotice("info", "x" * 2000),)))
        rows = [ObservationNotice(number + k / 10, 34.4, -120.5, 33.0, 1, (1,) * 7) for k in range(10)]
        take(fleet, ObservationBatch(1, 10 * number, 0, 10 * number + 10, tuple(rows)))
    latest = fleet.everything("boat1")
    assert sum(len(line["text"]) for line in latest["log"]) <= 50_000
    assert 1000 <= len(latest["track"]) <= 2001
    assert latest["track"][-1][0] == 2999.9
