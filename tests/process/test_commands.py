"""`autonomy ctl` and the service over real zenoh: a bad line, restarts, strangers, a router's access control.

HALOCLINE_COMMANDS: so many rounds of troubles, without it one.
"""

import itertools
import json
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import zenoh

sys.path.insert(0, str(Path(__file__).parent))
from at_sea import VEHICLE, VESSEL, configure, operating
from bad_line import BadLine
from processes import Processes, Running, free_port, wait_until
from shore_helpers import session
from test_security import certificates, guarded_router, run_the_documentation
from test_security import session as secure_session

from autonomy import wire_commands as wire
from autonomy.command_memory import CommandMemory
from autonomy.effects import Answer, Outcome
from autonomy.endpoints import session_settings
from autonomy.events import CommandReceived
from autonomy.replay import replay
from autonomy.shell.command_desk import CommandDesk
from autonomy.shore.commanding import Commander
from autonomy.shore.subscriber import Subscriber

pytestmark = pytest.mark.process

ROUNDS = int(os.environ.get("HALOCLINE_COMMANDS", "1"))
SECRET = "0123456789abcdefghijklmn"


def token_file(folder: Path, name: str = "boat1.token", secret: str = SECRET) -> Path:
    file = folder / name
    file.write_text(secret + "\n")
    file.chmod(0o600)
    return file


def ctl(verb: str, at: str, *options: str, within_s: float = 60.0) -> subprocess.CompletedProcess[str]:
    words = (verb, "--vehicle", VEHICLE, "--connect", at, "--timeout", str(within_s), *options)
    return subprocess.run(
        [sys.executable, "-m", "autonomy", "ctl", *words], capture_output=True, text=True, check=False
    )


def commands_in(said: str) -> list[str]:
    """What was carried out, each as `VERB (ID`."""
    lines = [line for line in said.splitlines() if "command from ashore" in line]
    return [line.split("command from ashore: ")[1].split(")")[0] for line in lines]


def carried_out(state: Path) -> list[Answer]:
    """What the core was asked to do and did, by its own journal, over all runs of the service."""
    told: list[Answer] = []
    folder = next(state.rglob("journal"))
    newest = max(int(file.name[3:9]) for file in folder.glob("*.journal"))
    outcome = replay(
        folder,
        newest,
        heard=lambda _, effects: told.extend(each for each in effects if isinstance(each, Answer)),
    )
    assert outcome.differences == []
    return told


class Chaos:
    """A line that is cut and silenced, and a router and a service that are killed, while commands go through."""

    def __init__(self, folder: Path, processes: Processes, shore_at: str, line: BadLine) -> None:
        self._processes, self._shore_at, self._line = processes, shore_at, line
        self.port = free_port()
        self.state = folder / "state"
        self._configuration = configure(
            folder,
            f"udpin:127.0.0.1:{self.port}",
            [line.endpoint],
            shore={"commands": {"token_file": str(token_file(folder))}},
        )
        self.said: list[str] = []
        self.router = self._new_router()
        self.service = self._new_service()

    def _new_router(self) -> Running:
        return self._processes.start("-m", "autonomy", "shore", "watch", VEHICLE, "--listen", self._shore_at)

    def _new_service(self) -> Running:
        return self._processes.service(self._configuration, environment={"XDG_STATE_HOME": str(self.state)})

    def restart_router(self) -> None:
        self.router.kill()
        self.router = self._new_router()

    def restart_service(self) -> None:
        self.service.kill()
        self.said.append(self.service.said)
        self.service = self._new_service()

    def disturb(self, stop: threading.Event) -> None:
        """One thing after the other, each for a while."""
        troubles = (self._line.cut, self.restart_service, self._line.silence, self.restart_router)
        for trouble in ROUNDS * troubles:
            trouble()
            stop.wait(1.5)
            self._line.mend()
            stop.wait(2.5)


def test_each_command_counts_once_through_losses_and_restarts(tmp_path: Path) -> None:
    shore_at, operator = f"tcp/127.0.0.1:{free_port()}", free_port()
    with Processes() as processes, BadLine(shore_at, delay_s=0.05) as line:
        chaos = Chaos(tmp_path, processes, shore_at, line)
        vessel = ("--listen", f"udpout:127.0.0.1:{chaos.port}", "--listen", f"tcp:127.0.0.1:{operator}")
        processes.vessel(*vessel, *VESSEL)
        with operating(f"tcp:127.0.0.1:{operator}"):
            chaos.service.wait_for("exploring: in AUTO")
            stop = threading.Event()
            troubles = threading.Thread(target=chaos.disturb, args=(stop,))
            troubles.start()
            answers = []
            settings = session_settings("client", connect=[shore_at])
            token = wire.Token(SECRET.encode())
            verbs = itertools.cycle(("pause", "resume", "replan"))
            while troubles.is_alive() or len(answers) < 3:
                verb = next(verbs)
                commander = Commander(settings, VEHICLE, token, threading.Event(), print)
                result = commander.ask(verb, 100.0)
                assert result.answer is not None, f"{verb}: no answer"
                assert result.recorded
                answers.append(result)
                print(
                    f"{verb}: {result.answer.outcome.value} after {result.sent} times: {result.answer.text}"
                )
            stop.set()
            troubles.join()
            assert chaos.service.stop() == 0
    told = carried_out(chaos.state)
    first: dict[bytes, Answer] = {}
    for answer in told:
        assert first.setdefault(answer.command_id, answer) == answer, "a repetition is answered as before"
    assert [first[result.command_id] for result in answers] == [result.answer for result in answers]
    assert len(first) == len(answers), "nothing else was ever carried out"
    logged: list[str] = []
    for run in map(commands_in, [*chaos.said, chaos.service.said]):
        # Who is killed may have said it before his journal had it: then nobody was answered, and the next one does it.
        logged += run[1:] if run and logged and run[0] == logged[-1] else run
    # Or he may not have come to say it.
    assert len(set(logged)) == len(logged) <= len(answers)


def test_what_strangers_ask_for_does_nothing_and_is_told(tmp_path: Path) -> None:
    port, shore_at = free_port(), f"tcp/127.0.0.1:{free_port()}"
    token, wrong = token_file(tmp_path), token_file(tmp_path, "wrong.token", "another secret altogether")
    configuration = configure(
        tmp_path, f"udpin:127.0.0.1:{port}", [shore_at], shore={"commands": {"token_file": str(token)}}
    )
    state = tmp_path / "state"
    with Processes() as processes, session("router", listen=[shore_at]) as router:
        service = processes.service(configuration, environment={"XDG_STATE_HOME": str(state)})
        service.wait_for("shore: connected")
        overheard: list[bytes] = []

        def overhear(query: zenoh.Query) -> None:
            overheard.append(bytes(query.payload or b""))

        router.declare_queryable("usv/*/command", overhear)
        refused = ctl("status", shore_at)
        assert (refused.returncode, refused.stdout) == (1, "")
        assert "not sealed with the vehicle's token" in refused.stderr
        doubtful = ctl("return", shore_at, "--token", str(wrong), within_s=2.0)
        assert doubtful.returncode == 3, "that may be said by anybody"
        assert "it is sealed with another token than the vehicle's; asking on" in doubtful.stderr
        assert "no answer in 2 s that could be verified, asked" in doubtful.stderr
        service.wait_for("commands from ashore: 1 unauthorised")
        with Subscriber(VEHICLE, connect=[shore_at]) as shore:
            wait_until(
                lambda: re.search(r"[2-9] unauth", getattr(shore.latest(VEHICLE).health, "security", "")),
                what="health",
            )
        sound = ctl("pause", shore_at, "--token", str(token), "--json")
        told = json.loads(sound.stdout)
        assert (sound.returncode, told["outcome"]) == (1, "refused")
        assert told["text"] == "nothing heard from the autopilot yet"
        # What was overheard, told again: the same answer, and nothing new.
        replies = [
            reply for data in set(overheard) for reply in router.get("usv/boat1/command", payload=data)
        ]
        again = [bytes(reply.ok.payload) for reply in replies if reply.ok]
        assert {
            wire.decode_answer(data, wire.Token(SECRET.encode()))[0].command_id.hex() for data in again
        } == {told["id"]}
        assert service.stop() == 0
        shown = subprocess.run(
            [sys.executable, "-m", "autonomy", "show-config", str(configuration)],
            capture_output=True,
            check=True,
        ).stdout
        assert len(commands_in(service.said)) == 1
        said = service.said.encode()
    assert b"boat1.token" in shown
    written = b"".join(file.read_bytes() for file in state.rglob("*") if file.is_file())
    assert b"boat1.token" in written
    for text in (said, shown, written):
        assert SECRET.encode() not in text


@pytest.mark.parametrize(("offset_s", "says"), [(-1000.0, "1000 s behind ours"), (3e7, "s ahead of ours")])
def test_a_boat_whose_clock_is_wrong_is_commanded_by_its_clock(offset_s: float, says: str) -> None:
    at, token, memory = f"tcp/127.0.0.1:{free_port()}", wire.Token(SECRET.encode()), CommandMemory()
    desk = CommandDesk(VEHICLE, accepted=True, token=token, fresh=False, utc_s=lambda: time.time() + offset_s)
    asked: list[CommandReceived] = []

    def core(command: CommandReceived) -> None:
        asked.append(command)
        outcome, text = memory.objection(0.0, command) or (Outcome.DONE, "so it is")
        about = (command.command_id, command.verb, outcome, text)
        desk.answered(Answer(*about, "", "", "", armed=False, utc_s=command.received_utc_s))

    desk.start(core)
    notes: list[str] = []
    with session("router", listen=[at]) as router, router.declare_queryable(f"usv/{VEHICLE}/*", desk.take):
        settings = session_settings("client", connect=[at])
        result = Commander(settings, VEHICLE, token, threading.Event(), notes.append).ask("pause", 30.0)
    desk.close()
    assert result.answer is not None
    assert result.answer.outcome is Outcome.DONE
    assert any(says in note for note in notes)
    assert len({command.command_id for command in asked}) == 2


def test_what_strangers_say_in_the_boats_name_is_not_believed_and_not_waited_for() -> None:
    """Somebody on the same network who answers at once that commands are off, sealed with nothing or another token."""
    at, token = f"tcp/127.0.0.1:{free_port()}", wire.Token(SECRET.encode())
    other = wire.Token(b"another, of 16 bytes")

    def lie(query: zenoh.Query) -> None:
        request = wire.decode_request(bytes(query.payload or b""), VEHICLE, None)
        answer = Answer(request.command_id, "pause", Outcome.REFUSED, "no", "", "", "", False, 0.0)
        with query:
            query.reply(wire.command_key(VEHICLE), wire.encode_answer(answer, recorded=True, token=other))
            query.reply_err("commands are off")

    def core(command: CommandReceived) -> None:
        desk.answered(Answer(command.command_id, "pause", Outcome.DONE, "", "", "", "", False, time.time()))

    desk = CommandDesk(VEHICLE, accepted=True, token=token, fresh=False)
    desk.start(core)
    notes: list[str] = []
    settings = session_settings("client", connect=[at])
    with session("router", listen=[at]) as router, router.declare_queryable(wire.command_key(VEHICLE), lie):
        commander = Commander(settings, VEHICLE, token, threading.Event(), notes.append)
        alone = commander.ask("pause", 1.5)
        with router.declare_queryable(f"usv/{VEHICLE}/*", desk.take):
            beside = Commander(settings, VEHICLE, token, threading.Event(), notes.append).ask("pause", 30.0)
    desk.close()
    assert (alone.answer, alone.error, alone.unverified) == (None, "", "commands are off")
    assert "not verified as boat1's: commands are off; asking on" in notes
    assert beside.answer is not None
    assert beside.answer.outcome is Outcome.DONE


def test_nobody_answers_for_a_vehicle_that_is_not_there(tmp_path: Path) -> None:
    shore_at = f"tcp/127.0.0.1:{free_port()}"
    alone = ctl("pause", shore_at, within_s=1.0)
    assert (alone.returncode, "the command was not sent" in alone.stderr) == (3, True)
    with session("router", listen=[shore_at]):
        unknown = ctl("pause", shore_at, within_s=2.0)
        assert unknown.returncode == 3
        assert "whether it was carried out is not known" in unknown.stderr
    for wrong, says in (
        (("--token", str(tmp_path / "none")), "--token: no readable file"),
        (("--certificate", "x.pem"), "--certificate and --key belong together"),
    ):
        usage = ctl("pause", shore_at, *wrong)
        assert (usage.returncode, says in usage.stderr) == (2, True)


@pytest.fixture(scope="module")
def papers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Keys and certificates as the documentation makes them."""
    folder = tmp_path_factory.mktemp("papers")
    run_the_documentation(folder)
    return folder


def test_the_router_lets_only_the_operator_command(papers: Path, tmp_path: Path) -> None:
    address = f"tls/127.0.0.1:{free_port()}"
    configuration = configure(
        tmp_path,
        f"udpin:127.0.0.1:{free_port()}",
        [address],
        shore={
            "commands": {"trust_router": True},
            "tls": {
                "root_ca": str(papers / "ca.pem"),
                "certificate": str(papers / "boat1.pem"),
                "private_key": str(papers / "boat1.key"),
            },
        },
    )

    def papers_of(name: str) -> tuple[str, ...]:
        own = ("--certificate", str(papers / f"{name}.pem"), "--key", str(papers / f"{name}.key"))
        return ("--ca", str(papers / "ca.pem"), *own)

    request = wire.encode_request(wire.Request(bytes(16), VEHICLE, "pause", time.time(), 60.0), None)
    with Processes() as processes, guarded_router(papers, address):
        service = processes.service(configuration)
        service.wait_for("shore: connected")
        sound = ctl("pause", address, *papers_of("operator"))
        assert (sound.returncode, "nothing heard from the autopilot" in sound.stderr) == (1, True)
        for name in ("shore", "boat2"):
            assert ctl("pause", address, *papers_of(name), within_s=3.0).returncode == 3
        with secure_session("client", address, certificates(papers, "shore")) as stranger:
            # These reach the boat, and are no commands there.
            for key in ("usv/boat1/*", "usv/*/*", "usv/boat1/com$*", "usv/*/command", "usv/boat1/command"):
                list(stranger.get(key, payload=request, timeout=1.0))
        assert len(commands_in(service.said)) == 1
        assert service.stop() == 0
