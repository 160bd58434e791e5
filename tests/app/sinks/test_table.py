"""One row a scheme: what is known is opened, what is not is refused with the known named."""

import re
from pathlib import Path

import pytest

from app.commands.options import DriveOptions
from app.sinks.protocols.send import SendSink
from app.sinks.table import HELP, SCHEMES, Address, Outlet, open_all, parse
from render.decoder.decoder import Decoder
from sensors.clock import ManualClock
from sensors.types import InputError


@pytest.mark.parametrize("scheme", ["", "osc", "VMCS", "http"])
def test_an_unknown_scheme_is_refused_naming_the_known(scheme: str, decoder: Decoder) -> None:
    outlet = Outlet(decoder, "ben", ManualClock())
    with pytest.raises(InputError) as error:
        open_all([f"{scheme}://127.0.0.1:1"], outlet)
    assert all(entry.example in str(error.value) for entry in SCHEMES.values())


@pytest.mark.parametrize("name", SCHEMES)
def test_every_example_is_of_its_own_scheme_and_names_the_default_port(name: str) -> None:
    example = SCHEMES[name].example
    host, port = parse(example).host, parse(example).port
    assert parse(f"{name}://{host}") == Address(f"{name}://{host}", name, host, port, "")
    assert f":{port}" in example
    with pytest.raises(InputError, match="expected an address like"):  # no usual port instead of it
        parse(f"{name}://{host}:0")


@pytest.mark.parametrize("name", SCHEMES)
def test_a_path_that_names_nothing_is_refused(name: str) -> None:
    """Red before: VMC went on without a word, and `ws` served another address than was typed."""
    url = f"{name}://127.0.0.1:9/face"
    if SCHEMES[name].path:
        assert parse(url).path == "face"
    else:
        with pytest.raises(InputError, match=f"got '/face'; try --send {name}://127.0.0.1:9$"):
            parse(url)


@pytest.mark.parametrize("name", [name for name in SCHEMES if SCHEMES[name].path])
def test_a_path_that_fills_a_datagram_is_refused(name: str) -> None:
    """Red before: no datagram of 70,000 bytes can be sent, and none was, without a word."""
    assert parse(f"{name}://127.0.0.1:9/{128 * 'é'}").path == 128 * "é"
    with pytest.raises(InputError, match="of 256 bytes at most .* got 258; give"):
        parse(f"{name}://127.0.0.1:9/{129 * 'é'}")


def test_datagrams_of_all_targets_share_one_thread(decoder: Decoder) -> None:
    urls = [entry.example for name, entry in SCHEMES.items() if name != "ws"]
    (sink,) = open_all(urls, Outlet(decoder, "ben", ManualClock()))
    assert isinstance(sink, SendSink) and [receiver.url for receiver in sink.receivers] == urls
    sink.close()


def test_help_names_every_scheme_and_readme_none_that_there_is_not() -> None:
    readme = (Path(__file__).parents[3] / "README.md").read_text()
    named = re.findall(r"^\| `(\w+)://", readme, re.M)
    assert len(named) >= 4 and set(named) <= set(SCHEMES)
    assert "`livedrive run -h` lists all" in readme
    assert all(entry.example in HELP for entry in SCHEMES.values())
    assert DriveOptions(send=("vmc://h",)).settings(realtime=False, draw=False, title="").network
