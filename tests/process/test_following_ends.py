"""Where following vehicles breaks off by a mistake of ours, whoever relies on it is told, and ends."""

import sys
from pathlib import Path

import pytest
from zenoh import ZError

from autonomy import cli
from autonomy.shore.session import ShoreSession
from autonomy.shore.subscriber import Subscriber

sys.path.insert(0, str(Path(__file__).parent))
from shore_helpers import SOON_S, free_endpoint, publisher

pytestmark = pytest.mark.process


def test_a_callback_that_raises_is_the_subscribers_failure(caplog: pytest.LogCaptureFixture) -> None:
    def broken(_: object) -> None:
        raise ArithmeticError("a mistake of the caller's")

    endpoint = free_endpoint()
    with Subscriber(listen=[endpoint], on_update=broken) as subscriber:
        with publisher(endpoint):
            assert subscriber.wait_for(lambda it: it.failed is not None, SOON_S)
        assert isinstance(subscriber.failed, ArithmeticError)
    assert "not followed any more" in caplog.text


@pytest.mark.parametrize("verb", ["serve", "record", "watch"])
def test_a_verb_whose_following_has_failed_ends_and_says_so(
    verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object) -> None:
        raise ZError("the session is closed")

    monkeypatch.setattr(ShoreSession, "ask", broken)
    own = {"serve": ["--http", "127.0.0.1:0"], "record": [str(tmp_path)], "watch": ["--timeout", "60"]}[verb]
    endpoint = free_endpoint()
    with publisher(endpoint):
        assert cli.main(["shore", verb, *own, "--listen", endpoint]) == 1
    assert "not followed any more: ZError('the session is closed')" in capsys.readouterr().err
