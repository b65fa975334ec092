"""``[plant.*]`` of a press file: what is taken, what is refused in one line, and secrets that never stand in it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.press.test_press_file import CONTRACT

from prooflight.errors import PressFileError
from prooflight.press.outlets import PlantBlock, address, is_loopback
from prooflight.press.press_file import PressFile
from prooflight_line.plant.outlets.configured import outlets_of
from prooflight_line.plant.outlets.mqtt import Mqtt
from prooflight_line.plant.outlets.opcua import OpcUa
from prooflight_line.plant.outlets.webhook import Webhook
from prooflight_line.plant.outlets.xjmf import XjmfAnswers, XjmfPush

WHOLE = """
[plant]
room = 500
[plant.mqtt]
host = "broker.plant"
topic = "hall 2/press"
user = "press"
password_file = "mqtt.secret"
[[plant.webhook]]
url = "http://plan.plant/hook"
secret_env = "HOOK_SECRET"
events = ["incident-opened", "incident-ended"]
[[plant.webhook]]
url = "https://other.plant/"
secret_file = "hook.secret"
[plant.xjmf]
url = "http://plan.plant/xjmf"
listen = "127.0.0.1:4712"
device_id = "press-2"
sheets = "alarms"
[plant.opcua]
listen = "127.0.0.1:4841"
"""


def press(text: str, folder: Path = Path()) -> PressFile:
    return PressFile(folder / "press-2.toml", CONTRACT + text)


def test_a_press_file_without_outlets_has_none() -> None:
    assert press("").plant == PlantBlock()
    assert outlets_of(press("")) == []


def test_outlets_are_made_as_the_file_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mqtt.secret").write_text("ink\n", encoding="utf-8")
    (tmp_path / "hook.secret").write_text("b" * 32, encoding="utf-8")
    monkeypatch.setenv("HOOK_SECRET", "a" * 16)
    file = press(WHOLE, tmp_path)
    assert file.plant.room == 500
    mqtt, hook, other, push, answers, opcua = outlets_of(file)
    assert isinstance(mqtt, Mqtt)
    assert (mqtt.host, mqtt.port, mqtt.topic, mqtt.user, mqtt.password) == (
        *("broker.plant", 1883, "hall 2/press", "press", "ink"),
    )
    assert isinstance(hook, Webhook)
    assert isinstance(other, Webhook)
    assert (hook.secret, hook.kinds) == (b"a" * 16, frozenset({"incident-opened", "incident-ended"}))
    assert (other.secret, other.kinds) == (b"b" * 32, None)
    assert isinstance(push, XjmfPush)
    assert (push.url, push.device_id, push.alarms_only) == ("http://plan.plant/xjmf", "press-2", True)
    assert isinstance(answers, XjmfAnswers)
    assert (answers.host, answers.port) == ("127.0.0.1", 4712)
    assert isinstance(opcua, OpcUa)
    assert (opcua.url, opcua.anonymous, opcua.certificate) == (
        "opc.tcp://127.0.0.1:4841/prooflight",
        True,
        None,
    )
    assert not any(word in repr(outlets_of(file)) for word in ("ink'", "aaaa", "bbbb"))


HOW_TO = Path(__file__).resolve().parents[4] / "docs" / "how-to" / "plant.md"
BLOCKS = re.findall(r"```toml\n(.*?)```", HOW_TO.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.partition("\n")[0])
def test_the_blocks_of_the_how_to_are_taken(block: str) -> None:
    assert press(block).plant != PlantBlock()


def test_topics_and_ports_have_defaults() -> None:
    [plain] = outlets_of(press('[plant.mqtt]\nhost = "b"\n'))
    [secure] = outlets_of(press('[plant.mqtt]\nhost = "b"\ntls = true\n'))
    assert isinstance(plain, Mqtt)
    assert isinstance(secure, Mqtt)
    assert (plain.port, plain.topic, plain.tls) == (1883, "prooflight/press-2", None)
    assert (secure.port, secure.tls is not None) == (8883, True)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[plant.mqtt]\nhots = "b"', "plant.mqtt.hots is not a known field"),
        ("[plant.mqtt]", "plant.mqtt.host is missing"),
        ('[plant.mqtt]\nhost = "b"\npassword = "ink"', "plant.mqtt.password is not a known field"),
        ('[plant.mqtt]\nhost = "b"\nport = 70000', "plant.mqtt.port"),
        ('[plant.mqtt]\nhost = "b"\ntopic = "a/#"', "plant.mqtt.topic"),
        ('[plant.mqtt]\nhost = "b"\npassword_file = "x"', "password_file needs user"),
        ('[plant.mqtt]\nhost = "b"\nca_file = "x"', "ca_file needs tls = true"),
        ('[plant.mqtt]\nhost = "b"\nuser = "u"\npassword_file = "x"\npassword_env = "X"', "not both"),
        ('[[plant.webhook]]\nurl = "http://h/"', "plant.webhook.1: needs secret_file or secret_env"),
        ('[[plant.webhook]]\nurl = "ftp://h/"\nsecret_env = "X"', "plant.webhook.1.url"),
        (
            '[[plant.webhook]]\nurl = "http://h/"\nsecret_env = "X"\nevents = ["sheets"]',
            "plant.webhook.1.events.1",
        ),
        ("[plant.xjmf]", "plant.xjmf: needs url, listen or both"),
        ('[plant.xjmf]\nlisten = "4712"', "listen must be HOST:PORT"),
        ('[plant.xjmf]\nurl = "http://h/"\ndevice_id = "a b"', "plant.xjmf.device_id"),
        (
            '[plant.opcua]\nlisten = "0.0.0.0:4840"',
            "listen beyond this machine (0.0.0.0) needs certificate_file",
        ),
        ('[plant.opcua]\ncertificate_file = "c.pem"', "needs both certificate_file and key_file"),
        ('[plant.opcua]\nuser = "u"', "needs user and either password_file or password_env"),
        ("[plant.opcua]\nanonymous = false", "anonymous = false needs user"),
        ('[plant.opcua]\nuser = "u"\npassword_env = "X"', "its password would be sent unencrypted"),
        ("[plant]\nroom = 0", "plant.room"),
        ("[plant.fax]\nnumber = 1", "plant.fax is not a known field"),
    ],
)
def test_what_no_outlet_can_be_is_refused_in_one_line(text: str, said: str) -> None:
    with pytest.raises(PressFileError) as caught:
        press(text)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


HOOK = '[[plant.webhook]]\nurl = "http://h/"\n'


@pytest.mark.parametrize(
    ("text", "file", "said"),
    [
        (HOOK + 'secret_file = "no.secret"', None, "plant.webhook.1.secret_file: no.secret cannot be read"),
        (HOOK + 'secret_file = "a.secret"', "", "plant.webhook.1.secret_file: a.secret is empty"),
        (HOOK + 'secret_file = "a.secret"', "a\nb", "a.secret holds more than a line"),
        (HOOK + 'secret_file = "a.secret"', "short", "the secret has 5 characters"),
        (HOOK + 'secret_env = "PROOFLIGHT_NO_SUCH"', None, "PROOFLIGHT_NO_SUCH is empty"),
        (
            '[plant.mqtt]\nhost = "b"\ntls = true\nca_file = "a.secret"',
            "no pem",
            "plant.mqtt.ca_file: a.secret cannot",
        ),
        (
            '[plant.opcua]\ncertificate_file = "c.pem"\nkey_file = "k.pem"',
            None,
            "plant.opcua.certificate_file: there is no file",
        ),
    ],
)
def test_a_secret_that_is_not_to_be_had_is_said_in_one_line(
    tmp_path: Path, text: str, file: str | None, said: str
) -> None:
    if file is not None:
        (tmp_path / "a.secret").write_text(file, encoding="utf-8")
    with pytest.raises(PressFileError) as caught:
        outlets_of(press(text, tmp_path))
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("text", "found"),
    [("127.0.0.1:4840", ("127.0.0.1", 4840)), ("[::1]:1", ("::1", 1)), ("plan.plant:80", ("plan.plant", 80))],
)
def test_addresses_are_host_and_port(text: str, found: tuple[str, int]) -> None:
    assert address(text) == found
    assert is_loopback(found[0]) == (found[0] != "plan.plant")


@pytest.mark.parametrize("text", ["", ":80", "host", "host:", "host:eighty", "host:70000", "host:-1"])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="HOST:PORT"):
        address(text)
