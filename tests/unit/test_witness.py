"""What is held against the mission that we believe to be on board."""

from itertools import pairwise

from autonomy.witness import LONGEST_PAUSE_S, PAUSE_S, MissionWitness


def doubts(witness, claims, *, now=0.0, slack_m=8.0, number=3):
    """Whether any of these (claimed, to ours) distances, one a second, each after the number, raises a doubt."""
    told = []
    for k, (claimed_m, distance_m) in enumerate(claims):
        witness.named(number)
        told.append(witness.doubts_way(now + k, claimed_m, distance_m, slack_m))
    return told


def test_three_distances_in_a_row_that_do_not_fit_raise_a_doubt():
    assert doubts(MissionWitness(), [(900, 300), (892, 300), (884, 300)]) == [False, False, True]


def test_what_fits_once_begins_the_count_anew():
    claims = [(900, 300), (892, 300), (300, 300), (884, 300), (876, 300)]
    assert not any(doubts(MissionWitness(), claims))


def test_roundings_clocks_and_a_simpler_earth_are_no_difference():
    assert not any(doubts(MissionWitness(), [(357, 300), (243, 300), (300, 357)] * 3))
    assert not any(doubts(MissionWitness(), [(40_300, 40_000), (65_535, 90_000)] * 3))
    assert doubts(MissionWitness(), [(500, 90_000)] * 3)[-1]


def test_an_autopilot_that_tells_no_distance_is_not_doubted():
    assert not any(doubts(MissionWitness(), [(0, 5_000)] * 20))


def test_a_distance_counts_only_with_the_number_it_belongs_to():
    witness = MissionWitness()
    witness.named(3)
    told = [witness.doubts_way(t, 900, 300, 8.0) for t in range(10)]
    assert not any(told), "the number was named once"
    for number in range(4, 20):  # waypoints that follow each other closely
        assert not any(doubts(witness, [(900, 300)] * 2, number=number))


def test_a_doubt_that_was_wrong_does_not_come_again_at_once():
    witness = MissionWitness()
    assert doubts(witness, [(900, 300)] * 3)[-1]
    assert not any(doubts(witness, [(900, 300)] * 50, now=3.0))
    assert any(doubts(witness, [(900, 300)] * 20, now=PAUSE_S))
    witness.reset()
    assert doubts(witness, [(900, 300)] * 3, now=PAUSE_S + 20.0)[-1], "of another mission"


def test_an_autopilot_that_never_fits_is_doubted_ever_more_rarely():
    witness = MissionWitness()
    told = doubts(witness, [(900, 300)] * 4000)
    when = [second for second, is_doubted in enumerate(told) if is_doubted]
    pauses = [after - before for before, after in pairwise(when)]
    assert pauses[:4] == [PAUSE_S, 2 * PAUSE_S, 4 * PAUSE_S, 8 * PAUSE_S]
    assert set(pauses[4:]) == {LONGEST_PAUSE_S}
    doubts(witness, [(300, 300)], now=4000.0)  # it fits
    told = doubts(witness, [(900, 300)] * 1000, now=5000.0)
    assert told[2]
    assert told[2 + int(PAUSE_S)]


def test_a_waypoint_reached_far_from_ours_raises_a_doubt():
    witness = MissionWitness()
    assert not witness.doubts_place(0.0, 70.0, 15.0, 8.0)
    assert witness.doubts_place(0.0, 75.0, 15.0, 8.0)
    assert not witness.doubts_place(1.0, 75.0, 15.0, 8.0)
