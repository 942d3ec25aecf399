import numpy as np

from sim_pybullet.racing.track import load_track
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.show import draws, sheet


def test_a_track_is_drawn_like_a_map() -> None:
    sample = load_look_sampler("tracks/dusk")
    pictures = draws(load_track("karting"), sample, 3, np.random.default_rng(0))
    assert pictures.shape == (3, 120, 160, 3)
    assert pictures.std(axis=(1, 2, 3)).min() > 10


def test_every_picture_is_on_the_sheet() -> None:
    pictures = np.stack([np.full((4, 5, 3), k, np.uint8) for k in range(1, 8)])
    assert sheet(pictures, 6).shape == (2 * 6, 6 * 7, 3)
    assert set(np.unique(sheet(pictures, 6))) == {*range(1, 8), 255}
