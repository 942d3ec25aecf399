"""Several sites are seen, each as one draw; a fixed look is one site."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from robot.errors import ConfigError
from robot.inference.policy import SHIPPED_MODELS
from robot.typed_config import read_json
from sim_pybullet.look import NOMINAL
from sim_pybullet.randomise import load_look_sampler
from tests import thorough
from tools.loop import drive
from tools.loop.__main__ import main
from tools.loop.cli import LoopOptions
from tools.loop.sites import sites_of

REALITY = {"reality/noon", "reality/night", "reality/rink", "reality/lab", "reality/hall"}


def test_a_fixed_look_is_the_only_site() -> None:
    site = sites_of("nominal", 4)
    assert site(0) == site(49)
    assert (site(0).name, site(0).look, site(0).until) == ("nominal", NOMINAL, None)


@pytest.mark.parametrize("seed", range(4))
def test_fifty_missions_in_reality_see_every_site_twice_and_each_draw_once(seed: int) -> None:
    site = sites_of("reality", seed)
    sites = [site(k) for k in range(50)]
    for name in REALITY:
        assert sum(s.name == name for s in sites) == 10
    assert len({s.look for s in sites}) == 10
    assert [s.until for s in sites[:11]] == [5] * 5 + [10] * 5 + [15]


def test_everything_of_a_site_is_of_one_draw() -> None:
    site = sites_of("reality", 7)
    for k in range(0, 50, 5):
        at = site(k)
        assert at.look == load_look_sampler(at.name)(np.random.default_rng((7, k // 5)))


def test_the_seed_draws_order_and_looks() -> None:
    drawn = [sites_of("reality", seed) for seed in range(4)]
    orders = {tuple(site(k).name for k in range(0, 25, 5)) for site in drawn}
    assert len(orders) > 2
    lab, other = sites_of("reality/lab", 1), sites_of("reality/lab", 2)
    assert lab(0) == lab(4)
    assert lab(0).look != other(0).look
    assert lab(0).look != lab(5).look


def test_a_folder_of_fixed_looks_is_one_site_after_the_other(tmp_path: Path) -> None:
    for name, brightness in (("a", 0.8), ("b", 1.2)):
        (tmp_path / f"{name}.yaml").write_text(f"ground: {{brightness: {brightness}}}")
    site = sites_of(str(tmp_path), 0)
    seen = {(Path(s.name).stem, s.look.ground.brightness) for s in (site(0), site(5))}
    assert seen == {("a", 0.8), ("b", 1.2)}


def test_an_unknown_look_is_refused_before_anything_starts(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(ConfigError, match="realty"):
        sites_of("realty", 0)
    assert main(["--look", "realty"]) == 2
    assert "reality" in capsys.readouterr().err


def test_the_figures_count_arrivals_at_each_site() -> None:
    rows = [
        {"site": "reality/lab", "arrived": True},
        {"site": "reality/lab", "arrived": False},
        {"site": "reality/hall", "arrived": True},
    ]
    assert drive.arrivals_at(rows) == {
        "reality/lab": {"missions": 2, "arrived": 1},
        "reality/hall": {"missions": 1, "arrived": 1},
    }


def test_missions_start_without_torch() -> None:
    program = "import sys, tools.loop.drive; sys.exit('torch' in sys.modules)"
    subprocess.run([sys.executable, "-c", program], check=True)


def test_figures_of_rows_without_sites_begin_anew(tmp_path: Path) -> None:
    path = tmp_path / "loop.json"
    options = LoopOptions(json=path)
    for schema, kept in ((1, 0), (2, 1)):
        figures = {"schema": schema, "inputs": drive.inputs_of(options), "rows": [{"site": "a"}]}
        path.write_text(json.dumps(figures))
        assert len(drive.rows_so_far(options)) == kept


@thorough.only
def test_without_a_localizer_a_person_tells_roughly_where_it_stands(tmp_path: Path) -> None:
    shipped, out = SHIPPED_MODELS, tmp_path / "one.json"
    words = ["--sight", str(shipped / "sight.onnx"), "--model", str(shipped / "nav_ppo.onnx")]
    assert main([*words, "--json", str(out)]) == 0
    figures = read_json(out)
    assert (figures["missions"], figures["arrived"]) == (1, 1)
    assert figures["position_rms_m"] < 0.08
