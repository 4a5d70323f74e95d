"""What goes wrong at sea: links, reboots, silence, jobs that fail, autopilots we don't know."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy import jobs
from autonomy.effects import Topic
from autonomy.events import JobFailed, JobFinished, MessageReceived, StopRequested
from autonomy.exploration import Trigger
from autonomy.mavlink.codec import Codec
from autonomy.planning.planners import PlanningError
from sim.autopilot import Mode


class FlakyJobs:
    """Jobs that go wrong as long as `trouble` is set; `asked` counts them."""

    def __init__(self, trouble):
        self.trouble = trouble
        self.asked = []

    def __call__(self, name, request, survey):
        self.asked.append(request)
        if self.trouble == "crash":
            raise RuntimeError("out of memory")
        result = jobs.run(name, request, survey)
        if self.trouble == "no plan":
            return jobs.ExploreResult(result.reestimate, None, str(PlanningError("no candidate")))
        return result


def test_the_vehicle_reboots_in_mid_survey_and_goes_on_when_it_is_started_again(voyage):
    voyage.advance(250.0)
    samples, basis = voyage.samples, voyage.health.basis_size
    voyage.reboot()
    booted = voyage.now
    voyage.advance(60.0)
    assert voyage.lines("on board: our mission is on board", since=booted)
    assert samples <= voyage.samples <= samples + 2
    assert voyage.health.basis_size >= basis
    assert len(voyage.said("MISSION_COUNT", since=booted)) <= 1
    position_asked = [
        m for m in voyage.said("COMMAND_LONG", since=booted) if m.command == 511 and m.param1 == 33
    ]
    assert len(position_asked) == 1
    voyage.arm()
    voyage.select(Mode.AUTO)
    voyage.until("exploring")
    voyage.advance(100.0)
    assert voyage.samples > samples
    assert voyage.health.model_time_s > 350.0  # goes on, though the vehicle's clock began anew


def test_a_link_lost_in_the_middle_of_an_upload(voyage):
    voyage.stall_upload_after(2)
    voyage.until_sent("MISSION_ITEM_INT", 3)
    voyage.cut_link()
    voyage.unstall()
    samples, verified = voyage.health.samples, voyage.verified
    cut = voyage.now
    voyage.advance(60.0)
    assert voyage.health.state == "waiting_for_vehicle"
    assert not voyage.health.link_ok
    voyage.restore_link()
    assert voyage.advance(30.0, until=lambda: voyage.verified > verified)
    assert len(voyage.said("MISSION_COUNT", since=cut)) == 1
    assert voyage.autopilot.navigator.current == 1
    assert voyage.health.samples >= samples
    assert voyage.health.state == "exploring"


def test_a_first_upload_that_was_complete_when_the_link_went_is_not_repeated(make_voyage):
    voyage = make_voyage()
    lists = iter(range(2))  # at first and before the upload, but none after it
    voyage.passes = lambda message: (
        message.get_type() != "MISSION_REQUEST_LIST"
        or message.mission_type != mavlink.MAV_MISSION_TYPE_MISSION
        or next(lists, None) is not None
    )
    assert voyage.advance(60.0, until=lambda: bool(len(voyage.on_board_m())))
    assert voyage.verified == 0
    voyage.cut_link()
    voyage.unstall()
    voyage.restore_link()
    voyage.advance(5.0)
    assert voyage.verified == 1
    voyage.start()
    assert len(voyage.said("MISSION_COUNT")) == 1


def test_an_autopilot_that_was_silent_is_asked_what_it_has_on_board(voyage):
    voyage.advance(60.0)
    samples, verified = voyage.samples, voyage.verified
    voyage.linked = False
    voyage.until("the autopilot has fallen silent")
    silent = voyage.now
    voyage.advance(20.0)
    assert voyage.traffic(since=silent) == []
    voyage.linked = True
    back = voyage.now
    voyage.advance(15.0)
    assert len(voyage.said("MISSION_REQUEST_LIST", since=back)) == 1
    assert not voyage.said("MISSION_COUNT", since=back)
    assert voyage.verified == verified
    assert voyage.samples >= samples
    assert voyage.health.state == "exploring"
    voyage.until("verified on board")


def test_a_plan_that_is_ready_while_the_autopilot_is_silent_is_not_sent_later(voyage):
    voyage.job_s = 20.0
    assert voyage.advance(1000.0, until=lambda: voyage.health.worker_busy)
    voyage.linked = False
    voyage.until("the new plan is dropped: the autopilot has fallen silent")
    voyage.linked = True
    voyage.until("plan 2")
    assert len(voyage.plans) == 2


@pytest.mark.parametrize("trouble", ["crash", "no plan"])
def test_without_a_plan_the_old_one_is_sailed_on_and_planning_is_tried_again(make_voyage, trouble):
    flaky = FlakyJobs(None)
    voyage = make_voyage(run_job=flaky)
    voyage.start()
    flaky.trouble = trouble
    voyage.until("trying again in 5 s")
    voyage.until("trying again in 10 s", patience_s=10.0)
    voyage.until("trying again in 20 s", patience_s=15.0)
    assert voyage.health.state == "exploring"
    assert voyage.verified == 1
    sailed = voyage.autopilot.vessel.distance_sailed_m
    voyage.advance(10.0)
    assert voyage.autopilot.vessel.distance_sailed_m > sailed + 50.0
    flaky.trouble = None
    voyage.until("verified on board", patience_s=60.0)
    assert voyage.lines("re-estimated")
    flaky.trouble = trouble
    voyage.until("trying again in 5 s")  # patience starts anew


def test_a_fence_that_flaps_does_not_shorten_the_pause_after_a_plan_that_failed(make_voyage):
    flaky = FlakyJobs(None)
    voyage = make_voyage(run_job=flaky)
    voyage.start()
    flaky.trouble = "no plan"
    voyage.until("trying again in 5 s")
    asked = len(flaky.asked)
    for _ in range(30):
        voyage.core._replanning.want(Trigger.FENCE)
        voyage.advance(1.0)
    assert 1 <= len(flaky.asked) - asked <= 2, "after 5 s and 10 s more"


def test_the_first_plan_is_tried_again_too(make_voyage):
    flaky = FlakyJobs("no plan")
    voyage = make_voyage(run_job=flaky)
    voyage.until("no plan: no candidate; trying again in 5 s")
    voyage.until("trying again in 10 s")
    flaky.trouble = None
    voyage.until("verified on board")


def test_results_that_nobody_waits_for_are_ignored(voyage):
    voyage.advance(100.0)
    log = list(voyage.log)
    voyage.happened(JobFinished(999, jobs.ExploreResult(None, None, "too late")))
    voyage.happened(JobFailed(1, "too late"))
    assert voyage.log == log


def test_a_late_result_does_not_pass_for_the_one_awaited(voyage):
    voyage.job_s = 20.0
    assert voyage.advance(1000.0, until=lambda: voyage.health.worker_busy)
    log = list(voyage.log)
    voyage.happened(JobFinished(1, jobs.ExploreResult(None, None, "too late")))
    voyage.happened(JobFailed(1, "too late"))
    assert voyage.log == log
    voyage.until("verified on board", patience_s=30.0)
    assert voyage.lines("re-estimated")


def test_an_autopilot_whose_modes_we_do_not_know_is_left_alone(make_voyage):
    voyage = make_voyage()
    reports = voyage.autopilot.reports
    reports._by_id[mavlink.MAVLINK_MSG_ID_HEARTBEAT] = lambda: mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_SURFACE_BOAT, mavlink.MAV_AUTOPILOT_PX4, 81, 0x04040000, mavlink.MAV_STATE_ACTIVE, 3
    )
    voyage.advance(60.0)
    assert voyage.traffic() == []
    assert voyage.health.state == "waiting_for_vehicle"
    assert "unsupported autopilot PX4" in voyage.health.reason
    assert not voyage.plans


def test_without_a_vehicle_the_core_waits_for_its_heartbeat_only(make_voyage):
    voyage = make_voyage()
    voyage.linked = False
    before = len(voyage.sent)
    voyage.advance(30.0)
    assert {each.get_type() for _, each in voyage.sent} == {"HEARTBEAT"}
    assert 25 <= len(voyage.sent) - before <= 31
    assert voyage.core.next_deadline() > voyage.now


def test_what_the_autopilot_writes_is_told(voyage):
    vehicle, own = Codec(voyage.autopilot.system_id, 1), Codec(voyage.autopilot.system_id, 191)
    for severity, text in [(3, b"EKF3 lane switch 1"), (6, b"Throttle armed")]:
        (message,) = own.decode(vehicle.encode(mavlink.MAVLink_statustext_message(severity, text)))
        voyage.happened(MessageReceived(message))
    voyage.advance(3.0)
    assert voyage.lines("autopilot: Throttle armed")
    ashore = {notice.text: notice.level for notice in voyage.published[Topic.LOG]}
    assert ashore["autopilot: EKF3 lane switch 1"] == "warning"
    assert ashore["autopilot: Throttle armed"] == "info"


def test_the_last_words(voyage):
    voyage.advance(100.0)
    voyage.happened(StopRequested())
    stopped = voyage.now
    assert voyage.log[-1][1] == "stopping"
    assert "service stops" in str(voyage.said("STATUSTEXT")[-1].text)
    voyage.advance(30.0)
    assert [each for time, each in voyage.sent if time > stopped] == []
