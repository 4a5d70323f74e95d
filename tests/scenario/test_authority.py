"""What the configuration lets us do with the boat, and how it is given back."""

from sim.autopilot import Mode

from .conftest import boat


def test_in_full_the_boat_is_started_and_sent_home_once(make_voyage):
    voyage = make_voyage(boat(ready_after_s=30.0), authority={"mode": "full", "return_battery": 0.5})
    voyage.advance(29.0)
    assert not voyage.autopilot.navigator.armed
    assert voyage.advance(30.0, until=lambda: bool(voyage.lines("exploring")))
    assert voyage.autopilot.navigator.mode is Mode.AUTO
    voyage.advance(60.0)
    battery = voyage.autopilot.vessel.battery
    battery.used_wh = 0.6 * battery.capacity_wh
    voyage.until("returning: on its way home (RTL)", patience_s=20.0)
    assert voyage.autopilot.navigator.mode is Mode.RTL
    returning = voyage.now
    voyage.advance(60.0)
    assert voyage.traffic(since=returning) == []
    voyage.select(Mode.AUTO)  # the operator has decided otherwise
    voyage.until("exploring: in AUTO under our mission")
    voyage.advance(60.0)
    assert voyage.autopilot.navigator.mode is Mode.AUTO


def test_in_full_a_boat_that_was_taken_is_not_started_again(make_voyage):
    voyage = make_voyage(authority={"mode": "full"})
    voyage.until("exploring: in AUTO under our mission", patience_s=60.0)
    voyage.select(Mode.HOLD)
    voyage.arm(armed=False)
    voyage.advance(5.0)
    taken = voyage.now
    voyage.advance(120.0)
    assert voyage.traffic(since=taken) == []
    assert voyage.autopilot.navigator.mode is Mode.HOLD
    assert not voyage.autopilot.navigator.armed


def test_with_resume_never_auto_does_not_give_the_boat_back(make_voyage):
    voyage = make_voyage(authority={"resume": "never"})
    voyage.start()
    voyage.select(Mode.HOLD)
    voyage.advance(10.0)
    taken, samples = voyage.now, voyage.samples
    voyage.select(Mode.AUTO)
    voyage.advance(200.0)
    assert voyage.traffic(since=taken) == []
    assert voyage.health.state == "yielded"
    assert "authority.resume: never" in voyage.health.reason
    assert voyage.samples > samples, "learning goes on"


def test_why_we_yield_is_said_to_the_operator(voyage):
    voyage.advance(30.0)
    voyage.select(Mode.MANUAL)
    voyage.advance(3.0)
    assert "the operator has the boat (MANUAL)" in str(voyage.said("STATUSTEXT")[-1].text)
