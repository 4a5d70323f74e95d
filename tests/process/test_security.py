"""Strangers on both ways to a boat: routers with certificates and access control, a signed link on real sockets."""

import contextlib
import json
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cbor2
import numpy as np
import pytest
import zenoh
from pymavlink.dialects.v20 import ardupilotmega as mavlink

sys.path.insert(0, str(Path(__file__).parent))
from at_sea import VEHICLE, VESSEL, configure, operating
from processes import Processes, free_port, wait_until
from shore_helpers import (
    health_notice,
    learnt_model,
    model_snapshot,
    observation,
    plan_notice,
    publisher,
)

from autonomy.effects import Topic
from autonomy.endpoints import Certificates, session_settings
from autonomy.mavlink.codec import Codec
from autonomy.mavlink.signing import Signing, SigningKey
from autonomy.shell import publisher as publisher_module
from autonomy.shell.publisher import Publisher
from autonomy.shore.subscriber import Subscriber
from autonomy.wire import VERSION

pytestmark = pytest.mark.process

REPOSITORY = Path(__file__).parents[2]
FENCE = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def run_the_documentation(folder: Path, *replacements: tuple[str, str]) -> None:
    """Everything that docs/security.md tells people to type, in a folder."""
    script = "\n".join(FENCE.findall((REPOSITORY / "docs" / "security.md").read_text()))
    for old, new in replacements:
        assert old in script
        script = script.replace(old, new)
    subprocess.run(["bash", "-euc", script], cwd=folder, check=True, capture_output=True, timeout=60)


@pytest.fixture(scope="module")
def papers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Keys and certificates as the documentation makes them."""
    folder = tmp_path_factory.mktemp("papers")
    run_the_documentation(folder, ("boat1 boat2 shore operator", "boat1 boat2 boat3 shore operator"))
    return folder


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same names from another authority."""
    folder = tmp_path_factory.mktemp("foreign")
    run_the_documentation(folder)
    return folder


@contextlib.contextmanager
def opened(config: zenoh.Config) -> Iterator[zenoh.Session]:
    with zenoh.open(config) as session:
        yield session


@contextlib.contextmanager
def guarded_router(papers: Path, address: str) -> Iterator[zenoh.Session]:
    """The example router, at this address, with these papers."""
    text = (REPOSITORY / "config" / "router.json5").read_text()
    for old, new in (("/etc/zenoh/", f"{papers}/"), ("tls/[::]:7447", address)):
        assert old in text
        text = text.replace(old, new)
    file = papers / "router.json5"
    file.write_text(text)
    with opened(zenoh.Config.from_file(str(file))) as session:
        yield session


def certificates(papers: Path, name: str | None, trusts: Path | None = None) -> Certificates:
    own = (None, None) if name is None else (papers / f"{name}.pem", papers / f"{name}.key")
    return Certificates((trusts or papers) / "ca.pem", *own)


def session(mode: Any, address: str, papers: Certificates) -> Any:
    config = zenoh.Config()
    settings = session_settings(mode, connect=[address], certificates=papers)
    for path, value in settings.items():
        config.insert_json5(path, json.dumps(value))
    return opened(config)


def publish_all(boat: Publisher) -> None:
    boat.publish(Topic.PLAN, plan_notice())
    boat.publish(Topic.HEALTH, health_notice())
    boat.publish(Topic.OBSERVATIONS, (observation(0),))


@pytest.mark.parametrize("protocol", ["tls", "quic"])
def test_with_its_own_certificate_everything_gets_through(papers: Path, protocol: str) -> None:
    address = f"{protocol}/127.0.0.1:{free_port()}"
    with (
        guarded_router(papers, address),
        Subscriber("*", [address], certificates=certificates(papers, "shore")) as shore,
        publisher(address, "boat1", certificates=certificates(papers, "boat1")) as boat,
    ):
        publish_all(boat)
        wait_until(lambda: shore.latest("boat1").plan, what="a plan")
        wait_until(lambda: shore.track("boat1"), what="an observation")
        wait_until(lambda: boat.status.asked, what="a question")
        wait_until(lambda: boat.status.trouble == "", what="health without doubts")
        assert shore.latest("boat1").alive


REFUSED = {
    "no certificate": ("boat1", None, "not connected: no router answers, or it refuses us"),
    "a foreign certificate": ("boat1", "foreign", "not connected: no router answers, or it refuses us"),
    "a name that the router does not know": ("boat3", "boat3", "connected, and nobody listens"),
    "another boat's key": ("boat1", "boat2", "connected, and nobody has asked for the latest"),
}


@pytest.mark.parametrize(("vehicle", "shows", "says"), REFUSED.values(), ids=REFUSED)
def test_who_is_refused_delivers_nothing_and_health_shows_it(
    papers: Path, foreign: Path, monkeypatch: pytest.MonkeyPatch, vehicle: str, shows: str | None, says: str
) -> None:
    monkeypatch.setattr(publisher_module, "_UNASKED_S", 1.0)
    address = f"tls/127.0.0.1:{free_port()}"
    # The foreign boat trusts our router; it is the router that must not trust the boat.
    own = certificates(foreign, "boat1", papers) if shows == "foreign" else certificates(papers, shows)
    heard: list[str] = []
    with (
        guarded_router(papers, address) as router,
        session("client", address, certificates(papers, "shore")) as ashore,
        Subscriber("*", [address], certificates=certificates(papers, "shore")) as shore,
        publisher(address, vehicle, certificates=own) as boat,
        publisher(address, "boat2" if vehicle == "boat1" else "boat1", certificates=Certificates()) as nobody,
    ):
        for each in (router, ashore):
            each.declare_subscriber("**", lambda sample: heard.append(str(sample.key_expr)))
        publish_all(boat)
        publish_all(nobody)
        wait_until(lambda: boat.status.trouble.startswith(says), what=f"{says!r}")
        publish_all(boat)
        time.sleep(1.0)
        assert heard == []
        assert [reply for reply in ashore.get("usv/**", timeout=1.0) if reply.ok] == []
        assert [reply for reply in ashore.liveliness().get("usv/**", timeout=1.0) if reply.ok] == []
        assert shore.vehicles() == []
        assert boat.status.trouble.startswith(says)
        # The same router at the same time: it is not that nothing gets through at all.
        with publisher(address, "boat1", certificates=certificates(papers, "boat1")) as welcome:
            publish_all(welcome)
            wait_until(lambda: shore.latest("boat1").plan, what="the welcome one's plan")


def test_a_boat_tells_a_foreign_router_nothing(papers: Path, foreign: Path) -> None:
    """Whoever takes the router's place, by its name, its address or another of our certificates."""
    for host, router_papers, trusted, verifies, gets_through in (
        ("127.0.0.1", foreign, papers, True, False),
        ("127.0.0.2", papers, papers, True, False),
        ("127.0.0.2", papers, papers, False, True),
    ):
        address = f"tls/{host}:{free_port()}"
        heard: list[str] = []
        own = Certificates(trusted / "ca.pem", papers / "boat1.pem", papers / "boat1.key", verifies)
        config = zenoh.Config()
        listening = certificates(router_papers, "router", papers)
        for path, value in session_settings("router", listen=[address], certificates=listening).items():
            config.insert_json5(path, json.dumps(value))
        with opened(config) as router, publisher(address, "boat1", certificates=own) as boat:
            router.declare_subscriber("**", lambda sample, heard=heard: heard.append(str(sample.key_expr)))
            publish_all(boat)
            if gets_through:
                wait_until(lambda heard=heard: heard, what="what is told with verify_name: false")
            else:
                time.sleep(2.0)
                assert heard == []
                assert boat.status.trouble.startswith("not connected")


def test_the_shore_may_ask_a_boat_and_boats_neither_hear_nor_ask_each_other(papers: Path) -> None:
    address = f"tls/127.0.0.1:{free_port()}"
    request = cbor2.dumps({"v": VERSION, "points_deg": cbor2.CBORTag(86, np.array([34.4, -120.5]).tobytes())})
    model, _ = learnt_model()
    overheard: list[str] = []
    with (
        guarded_router(papers, address),
        publisher(address, "boat1", certificates=certificates(papers, "boat1")) as boat,
        session("client", address, certificates(papers, "boat2")) as other,
        session("client", address, certificates(papers, "shore")) as ashore,
    ):
        for key in ("**", "usv/boat1/**", "usv/boat1/observations"):
            other.declare_subscriber(key, lambda sample: overheard.append(str(sample.key_expr)))
        boat.publish(Topic.MODEL, model_snapshot(model))
        boat.publish(Topic.OBSERVATIONS, tuple(map(observation, range(5))))
        questions = {"usv/boat1/observations?from=0;count=9": None, "usv/boat1/predict": request}
        for question, payload in questions.items():
            # The query finds the boat as soon as the router knows that it answers.
            wait_until(
                lambda question=question, payload=payload: [
                    reply for reply in ashore.get(question, payload=payload, timeout=5.0) if reply.ok
                ],
                what=f"an answer to {question}",
            )
            assert [reply for reply in other.get(question, payload=payload, timeout=1.0) if reply.ok] == []
        publish_all(boat)
        time.sleep(0.5)
        assert overheard == []
        with Subscriber("boat1", [address], certificates=certificates(papers, "shore")) as shore:
            wait_until(lambda: shore.latest("boat1").health, what="the boat's health")
            other.put("usv/boat1/plan", b"false")
            time.sleep(0.5)
            assert shore.counters.refused == 0


class Stranger:
    """A UDP socket with something to say to a service, which also overhears the boat."""

    def __init__(self, port: int, codec: Codec) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._codec = codec
        self.sent = 0

    def __enter__(self) -> "Stranger":
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def lie(self) -> None:
        """A reading that would spoil the map, and a mode that would end the survey."""
        reading = mavlink.MAVLink_named_value_float_message(1000, b"SALT", 99.0)
        hold = mavlink.MAVLink_heartbeat_message(11, 3, 81, 4, 5, 3)
        for message in (reading, hold):
            self.say(self._codec.encode(message))

    def say(self, packet: bytes) -> None:
        with contextlib.suppress(ConnectionRefusedError):
            self._socket.send(packet)
            self.sent += 1


def everything_in(folder: Path) -> bytes:
    return b"\n".join(file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file())


def test_a_signed_survey_goes_on_under_attack_and_no_secret_gets_out(papers: Path, tmp_path: Path) -> None:
    port, operator, shore_at = free_port(), free_port(), f"tls/127.0.0.1:{free_port()}"
    passphrase = (papers / "boat1.signing").read_bytes().strip()
    key = SigningKey.from_file_content(passphrase, "passphrase")
    state = tmp_path / "state"
    configuration = configure(
        tmp_path,
        f"udpin:127.0.0.1:{port}",
        [shore_at],
        mavlink={"signing": {"key_file": str(papers / "boat1.signing")}},
        shore={
            "tls": {
                "root_ca": str(papers / "ca.pem"),
                "certificate": str(papers / "boat1.pem"),
                "private_key": str(papers / "boat1.key"),
            }
        },
        logging={"level": "debug"},
    )
    signed = ("--signing-key", str(papers / "boat1.signing"))
    where = ("--listen", f"udpout:127.0.0.1:{port}", "--listen", f"tcp:127.0.0.1:{operator}")
    with (
        Processes() as processes,
        guarded_router(papers, shore_at),
        Subscriber(VEHICLE, [shore_at], certificates=certificates(papers, "shore")) as shore,
        Stranger(port, Codec(1, 1)) as unsigned,
        Stranger(port, Codec(1, 1, Signing(SigningKey(bytes(32)), lambda: 4e9))) as wrong,
    ):
        service = processes.service(configuration, environment={"XDG_STATE_HOME": str(state)})
        processes.vessel(*where, *VESSEL, *signed)

        def learnt() -> int:
            for stranger in (unsigned, wrong):
                stranger.lie()
            model = shore.latest(VEHICLE).model
            return 0 if model is None else model.samples

        with operating(f"tcp:127.0.0.1:{operator}", key) as bridge:
            service.wait_until(lambda: learnt() >= 10, 60.0, what="10 samples")
            # What the boat has said to its operator, said again to the service.
            with Stranger(port, Codec(1, 1)) as replays:
                for message in list(bridge.heard):
                    replays.say(bytes(message.get_msgbuf()))
            learnt_so_far = learnt()
            service.wait_until(lambda: learnt() >= learnt_so_far + 3, what="3 more")

        def refused() -> list[str]:
            health = shore.latest(VEHICLE).health
            return [] if health is None else re.findall(r"\d+ ([a-z ]+)", health.security)

        service.wait_until(
            lambda: refused() == ["unsigned", "wrongly signed", "replayed"], what="the refusals in health"
        )
        assert all(reading.value < 50.0 for reading in shore.track(VEHICLE))
        assert "HOLD" not in service.said
        assert service.stop() == 0
        said = service.said
    shown = subprocess.run(
        [sys.executable, "-m", "autonomy", "show-config", str(configuration)], capture_output=True, check=True
    ).stdout
    assert b"boat1.signing" in shown
    private = [line for line in (papers / "boat1.key").read_bytes().splitlines() if b"-" not in line]
    written = everything_in(state)
    assert b"signing" in written
    for secret in (passphrase, key._secret, key._secret.hex().encode(), *private):
        for text in (said.encode(), shown, written):
            assert secret not in text


def recorded(folder: Path) -> Iterator[bytes]:
    """Every packet that the service has received or sent, from its recording of the link."""
    for file in sorted(folder.rglob("*.tlog")):
        data = file.read_bytes()
        while len(data) > 11:
            length = data[9] + (25 if data[10] & 1 else 12)
            yield data[8 : 8 + length]
            data = data[8 + length :]


def test_after_a_kill_nothing_of_what_was_said_is_believed_again(papers: Path, tmp_path: Path) -> None:
    port, shore_at, state = free_port(), f"tcp/127.0.0.1:{free_port()}", tmp_path / "state"
    signing = {"signing": {"key_file": str(papers / "boat1.signing")}}
    configuration = configure(tmp_path, f"udpin:127.0.0.1:{port}", [shore_at], mavlink=signing)
    environment = {"XDG_STATE_HOME": str(state)}
    signed = ("--signing-key", str(papers / "boat1.signing"))
    with Processes() as processes, Subscriber(VEHICLE, listen=[shore_at]) as shore:
        first = processes.service(configuration, environment=environment)
        vessel = processes.vessel("--listen", f"udpout:127.0.0.1:{port}", *VESSEL, *signed)
        first.wait_for("waypoints verified on board", 60.0)
        first.kill()
        vessel.kill()
        again = processes.service(configuration, environment=environment)
        again.wait_for("link to the vehicle is open")
        packets = list(recorded(state))
        assert len(packets) > 200
        with Stranger(port, Codec(1, 1)) as stranger:
            for packet in packets:
                stranger.say(packet)
                time.sleep(1e-3)

        def health() -> Any:
            return shore.latest(VEHICLE).health

        def replayed() -> int:
            found = re.fullmatch(r"refused: (\d+) replayed", health().security if health() else "")
            return int(found[1]) if found else 0

        # A socket whose owner is busy loses datagrams.
        again.wait_until(lambda: replayed() > 0.5 * len(packets), what=f"{len(packets)} refusals")
        assert [packet for packet in recorded(state) if packet[6] == 1] == [
            packet for packet in packets if packet[6] == 1
        ]
        assert not health().link_ok
        assert health().state == "waiting_for_vehicle"
        # The vessel itself is believed at once, though it has said nothing meanwhile.
        processes.vessel("--listen", f"udpout:127.0.0.1:{port}", *VESSEL, *signed)
        again.wait_until(lambda: health().link_ok, what="the vessel itself")


def test_a_vessel_without_the_key_is_not_heard_and_health_says_why(papers: Path, tmp_path: Path) -> None:
    port, shore_at = free_port(), f"tcp/127.0.0.1:{free_port()}"
    signing = {"signing": {"key_file": str(papers / "boat1.signing")}}
    configuration = configure(tmp_path, f"udpin:127.0.0.1:{port}", [shore_at], mavlink=signing)
    with Processes() as processes, Subscriber(VEHICLE, listen=[shore_at]) as shore:
        service = processes.service(configuration)
        processes.vessel("--listen", f"udpout:127.0.0.1:{port}", *VESSEL)

        def health() -> Any:
            return shore.latest(VEHICLE).health

        service.wait_until(
            lambda: health() and " unsigned" in health().security, what="the refusals in health"
        )
        assert health().state == "waiting_for_vehicle"
        assert health().reason == "nothing heard from the autopilot yet"
        service.wait_for("MAVLink packets that are not signed as they should be: refused: ")


def test_watching_with_certificates(papers: Path) -> None:
    """`autonomy shore watch` as the router itself: it lets in whoever comes from the authority, and nobody else."""
    address = f"tls/127.0.0.1:{free_port()}"
    options = ("--ca", str(papers / "ca.pem"), "--certificate", str(papers / "router.pem"))
    key = ("--key", str(papers / "router.key"))
    with Processes() as processes:
        watch = processes.start("-m", "autonomy", "shore", "watch", "--listen", address, *options, *key)
        with publisher(address, "boat1", certificates=Certificates(papers / "ca.pem")) as stranger:
            publish_all(stranger)
            with publisher(address, "boat2", certificates=certificates(papers, "boat2")) as boat:
                publish_all(boat)
                watch.wait_for("boat2: connected")
            assert stranger.status.trouble.startswith("not connected")
        assert "boat1" not in watch.said
        assert watch.stop() == 0
    for wrong, why in (
        (options, "--certificate and --key belong together"),
        (
            ("--ca", str(papers / "ca.pem")),
            "to listen with tls/ or quic/ needs --ca, --certificate and --key",
        ),
    ):
        ended = subprocess.run(
            [sys.executable, "-m", "autonomy", "shore", "watch", "--listen", address, *wrong],
            capture_output=True,
            text=True,
            check=False,
        )
        assert (ended.returncode, why in ended.stderr) == (2, True)
