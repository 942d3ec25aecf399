"""Nobody reaches the page without its token, and no page of another site reaches it at all."""

import socket
from collections.abc import Iterator

import pytest
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from starlette.testclient import TestClient
from starlette.websockets import WebSocket, WebSocketDisconnect

from tools.monitor.access import AccessGate

ORIGIN = "http://127.0.0.1:8600"
LIVE = "ws://127.0.0.1:8600/ws"


async def hello(_: object) -> PlainTextResponse:
    return PlainTextResponse("hello")


async def echo(live: WebSocket) -> None:
    await live.accept()
    await live.send_text("hello")


def client(host: str = "127.0.0.1", base_url: str = ORIGIN) -> TestClient:
    routes = [Route("/", hello, methods=["GET", "POST"]), WebSocketRoute("/ws", echo)]
    return TestClient(AccessGate(Starlette(routes=routes), "secret", host), base_url=base_url)


@pytest.fixture
def known() -> Iterator[TestClient]:
    """A browser that has shown the token."""
    with client() as browser:
        assert browser.get("/?token=secret").status_code == 200
        yield browser


def websocket_opens(browser: TestClient, **headers: str) -> bool:
    try:
        with browser.websocket_connect(LIVE, headers=headers) as live:
            return live.receive_text() == "hello"
    except WebSocketDisconnect as error:
        return error.code != 1008  # against the rules: no reason to try again


def test_the_token_becomes_a_cookie_that_scripts_and_other_sites_cannot_use() -> None:
    browser = client()
    assert browser.get("/").status_code == 401
    answer = browser.get("/?token=secret")
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert "secret" not in answer.text
    assert browser.get("/").text == "hello"


@pytest.mark.parametrize(
    "path",
    [
        *("/", "/?token=", "/?token=wrong", "/?token=s%C3%A9cret", "/?token=SECRET"),
        *("/static/page.js", "/api/drives", "/api/drives/x/picture?t_s=0&token=wrong"),
    ],
)
def test_without_the_token_nothing_is_shown(path: str) -> None:
    answer = client().get(path)
    assert answer.status_code == 401
    assert "token" in answer.text
    assert not websocket_opens(client(), origin=ORIGIN)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "http://127.0.0.1:8601", "https://127.0.0.1.evil", "null", ""]
)
def test_other_sites_can_neither_post_nor_listen(known: TestClient, origin: str) -> None:
    assert known.post("/", headers={"origin": origin}).status_code == 403
    assert not websocket_opens(known, origin=origin)


def test_on_the_usual_port_no_name_that_begins_like_ours_is_ours() -> None:
    browser = client(base_url="http://127.0.0.1")
    assert browser.get("/?token=secret").status_code == 200
    for ours in ("http://127.0.0.1", "https://127.0.0.1"):  # https: behind a proxy
        assert browser.post("/", headers={"origin": ours}).status_code == 200
    for theirs in ("http://127.0.0.1.evil.example", "https://127.0.0.1:8080"):
        assert browser.post("/", headers={"origin": theirs}).status_code == 403


def test_a_request_that_hides_its_origin_cannot_post(known: TestClient) -> None:
    assert known.post("/").status_code == 403


@pytest.mark.parametrize("method", ["OPTIONS", "PUT", "PATCH", "DELETE", "TRACE"])
def test_whatever_is_no_reading_needs_our_own_origin(known: TestClient, method: str) -> None:
    assert known.request(method, "/").status_code == 403
    assert known.request(method, "/?token=secret").status_code == 403


def test_a_stranger_is_told_of_the_token_and_not_of_sizes() -> None:
    headers = {"origin": ORIGIN, "content-length": "99999999"}
    assert client().post("/", headers=headers).status_code == 401
    assert client().post("/?token=secret", headers=headers).status_code == 401


def test_the_page_itself_can_post_and_listen(known: TestClient) -> None:
    assert known.post("/", headers={"origin": ORIGIN}).text == "hello"
    assert websocket_opens(known, origin=ORIGIN)


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "", "[::1"])
def test_names_that_others_can_bend_to_this_address_are_refused(
    known: TestClient, host: str
) -> None:
    """DNS rebinding: the browser believes that our address is another site's."""
    assert known.get("/", headers={"host": host}).status_code == 400


@pytest.mark.parametrize(
    ("header", "value", "status"),
    [("host", "127.0.0.1:99999", 400), ("host", "127.0.0.1:x", 400), ("origin", "http://[", 401)],
)
def test_headers_that_are_no_addresses_are_refused(header: str, value: str, status: int) -> None:
    assert client().get("/", headers={header: value}).status_code == status
    assert client().get("/?token=secret", headers={"origin": "http://["}).status_code == 200


def test_a_wildcard_address_is_reached_by_number_but_not_by_any_name() -> None:
    number = client("0.0.0.0", "http://192.168.1.20:8600")
    assert number.get("/?token=secret").status_code == 200
    assert number.get("/").text == "hello"
    assert client("0.0.0.0", "http://evil.example:8600").get("/?token=secret").status_code == 400


def test_a_wildcard_address_is_reached_by_the_computers_own_names() -> None:
    name = socket.gethostname().lower()
    for own in (name, f"{name}.local"):
        assert client("0.0.0.0", f"http://{own}:8600").get("/?token=secret").status_code == 200


@pytest.mark.parametrize(
    ("listening", "host"),
    [
        *(("127.0.0.1", host) for host in ("192.168.1.20:8600", "[fe80::1]:8600", "127.0.0.1:0")),
        *(("0.0.0.0", host) for host in ("192.168.1.20:0", "192.168.1:8600")),
    ],
)
def test_an_address_where_it_does_not_listen_is_not_its_own(listening: str, host: str) -> None:
    assert client(listening).get("/?token=secret", headers={"host": host}).status_code == 400


def test_a_wildcard_address_of_the_newer_kind_is_reached_by_number_too() -> None:
    number = client("::", "http://[fe80::1]:8600")
    assert number.get("/?token=secret").status_code == 200


@pytest.mark.parametrize(
    ("url", "name"),
    [
        (ORIGIN, "duckpilot_8600"),
        ("http://127.0.0.1:9000", "duckpilot_9000"),
        ("http://127.0.0.1", "duckpilot_80"),
    ],
)
def test_two_monitors_of_one_computer_have_a_cookie_each(url: str, name: str) -> None:
    cookie = client(base_url=url).get("/?token=secret").headers["set-cookie"]
    assert cookie.startswith(f"{name}=secret;")


def test_every_answer_forbids_framing_and_foreign_code(known: TestClient) -> None:
    for answer in (known.get("/"), client().get("/")):
        policy = answer.headers["content-security-policy"].split("; ")
        closed = {f"{what} 'none'" for what in ("frame-ancestors", "base-uri", "form-action")}
        assert closed | {"default-src 'self'", "connect-src 'self'"} <= set(policy)
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "no-referrer", "the address holds the token"
        assert answer.headers["cache-control"] == "no-store"
