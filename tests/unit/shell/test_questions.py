"""What is asked of a vehicle: nothing that somebody asks may keep the rest of the service from running."""

import pytest
import zenoh

from autonomy.shell.outbox import Outbox
from autonomy.shell.questions import Questions
from autonomy.shell.rate_limit import RateLimit

VEHICLE = "a" * 32


class Query:
    """As zenoh's."""

    payload = None

    def __init__(self, key: str) -> None:
        self.key_expr = zenoh.KeyExpr(key)
        self.parameters: dict[str, str] = {}
        self.error = ""

    def reply_err(self, text: str) -> None:
        self.error = text

    def __enter__(self) -> "Query":
        return self

    def __exit__(self, *_: object) -> None:
        return


@pytest.fixture
def questions() -> Questions:
    limit = RateLimit(None)
    return Questions(VEHICLE, Outbox(1, 10, 10, "16 bit", limit), limit)


def test_a_key_that_takes_for_ever_to_compare_is_not_compared(questions: Questions) -> None:
    """This one takes half a minute for each topic, and no other thread runs meanwhile: the watchdog would strike."""
    query = Query("usv/" + "$*a" * 12 + "$*b/model")
    questions.add(query)
    assert query.error == "a key must have at most 200 characters and 3 times $*"
    long = Query("usv/" + "/".join(["**", "a"] * 80))
    questions.add(long)
    assert long.error == query.error
    assert len(questions) == 0


@pytest.mark.parametrize(
    "key", [f"usv/{VEHICLE}/model", "usv/*/*", "**", "usv/a$*/*", "usv/$*aa$*aa$*/model"]
)
def test_other_keys_are_waited_for(questions: Questions, key: str) -> None:
    query = Query(key)
    questions.add(query)
    assert (query.error, len(questions)) == ("", 1)
