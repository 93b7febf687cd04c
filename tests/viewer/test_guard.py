"""Whose pages may talk to the browser view, and what they may choose."""

import socket

import pytest

from spin_rl.config import ConfigError
from spin_rl.viewer.browser.guard import is_own

viser = pytest.importorskip("viser")
Browser = pytest.importorskip("spin_rl.viewer.browser.view").Browser


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.mark.parametrize(
    ("origin", "asked", "own"),
    [
        ("http://localhost:8080", "localhost:8080", True),
        ("http://127.0.0.1:8080", "127.0.0.1:8080", True),
        ("http://192.168.1.5:8080", "192.168.1.5:8080", True),
        ("http://[::1]:8080", "[::1]:8080", True),
        (None, "localhost:8080", True),
        ("https://evil.example", "localhost:8080", False),
        ("http://localhost:9999", "localhost:8080", False),
        ("null", "localhost:8080", False),
        ("http://evil.example:8080", "evil.example:8080", False),  # its name leads to this machine
        (None, "evil.example:8080", False),
        ("http://[", "localhost:8080", False),
        ("http://localhost:8080", None, False),
    ],
)
def test_only_pages_of_this_server_are_its_own(origin, asked, own):
    assert is_own(origin, asked, "127.0.0.1") == own


@pytest.mark.parametrize(("page", "status"), [(None, 101), ("own", 101), ("http://evil.example", 403)])
def test_the_origin_of_a_socket_is_checked(page, status):
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    port = free_port()
    origin = f"http://127.0.0.1:{port}" if page == "own" else page
    with Browser("127.0.0.1", port):
        try:
            with connect(f"ws://127.0.0.1:{port}", origin=origin, subprotocols=["viser-v0"]):
                found = 101
        except InvalidStatus as error:
            found = error.response.status_code
    assert found == status


class Chooser:
    """A drop-down as viser has it: a client can put anything into its value."""

    def __init__(self, *options):
        self.options, self.value = options, options[0]


def test_what_was_not_offered_gives_way_to_the_last_choice():
    with Browser("127.0.0.1", free_port()) as browser:
        chooser = Chooser("1x", "2x")
        browser._choosers = {id(chooser): (chooser.options, chooser.value)}
        chooser.value = "2x"
        assert browser._offered(chooser) == "2x"
        for value in ("0x", "/etc/passwd", "", 5):
            chooser.value = value
            assert browser._offered(chooser) == chooser.value == "2x"


def test_an_address_that_is_none_is_named():
    for host in ("no such host", "256.1.1.1", "a" * 300):
        with pytest.raises(ConfigError, match=r"^(host|port): ") as error:
            Browser(host, free_port())
        assert "\n" not in str(error.value)
