"""The live page: the same page, drawn anew when a run has news."""

import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from robot.errors import ConfigError
from tests.trainer.report.test_page import judge, make_run
from trainer.report.page import LiveReport


@pytest.fixture
def server(tmp_path: Path) -> Iterator[LiveReport]:
    make_run(tmp_path / "runs" / "a")
    with LiveReport([tmp_path / "runs"], tmp_path / "out", 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def get(server: LiveReport, path: str) -> str:
    with urllib.request.urlopen(f"{server.address}{path}") as answer:
        return str(answer.read().decode())


def test_the_page_and_its_stamp_change_when_a_run_has_news(
    server: LiveReport, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("trainer.report.page.PAUSE_S", 0.0)
    stamp, page = get(server, "stamp"), get(server, "")
    assert get(server, "stamp") == stamp
    assert "location.reload" in page
    assert "no evaluation yet" in page
    judge(make_run(tmp_path / "runs" / "b"))
    assert get(server, "stamp") != stamp
    assert "100.0 %" in get(server, "")


def test_news_wait_until_the_page_may_be_drawn_again(server: LiveReport, tmp_path: Path) -> None:
    stamp = get(server, "stamp")
    judge(make_run(tmp_path / "runs" / "b"))
    assert get(server, "stamp") == stamp


def test_nothing_but_the_page_is_served(server: LiveReport, tmp_path: Path) -> None:
    for path in ("runs/a/config.yaml", "../runs/a/config.yaml", "report.html"):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            get(server, path)
    with pytest.raises(ConfigError, match="expected a free one"):
        LiveReport([tmp_path / "runs"], tmp_path / "two", server.server_port)
