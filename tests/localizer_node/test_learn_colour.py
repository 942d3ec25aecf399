import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from localizer_node.colour import learn_colour, mask_of, to_hsv
from robot.errors import ConfigError
from tests.localizer_node.rigs import FLOOR_RGB, PAINT


def patch(rgb, noise=0.0):
    image = np.empty((40, 40, 3))
    image[:] = FLOOR_RGB
    image[10:30, 10:30] = rgb
    image += np.random.default_rng(0).normal(0.0, noise, image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("name", ["blue", "green", "magenta"])
@given(light=st.floats(0.6, 1.2))
def test_a_learned_colour_finds_its_patch_in_other_light_and_nothing_else(name, light):
    colour = learn_colour(name, patch(PAINT[name], noise=4.0), 20.0, 19.0)
    others = [paint for paint in PAINT if paint != name]
    dimmed = patch(np.array(PAINT[name]) * light, noise=4.0)
    assert (mask_of(to_hsv(dimmed), colour)[11:29, 11:29] > 0).mean() > 0.99
    assert not mask_of(to_hsv(dimmed), colour)[:9].any()
    for other in others:
        assert not mask_of(to_hsv(patch(PAINT[other])), colour).any()


def test_a_red_is_learned_across_the_end_of_the_hues():
    colour = learn_colour("red", patch((210, 20, 22), noise=3.0), 20.0, 20.0)
    assert colour.hue_min_deg > 330.0
    assert colour.hue_max_deg < 30.0
    assert mask_of(to_hsv(patch((210, 20, 22))), colour)[20, 20]


def test_grey_and_outside_are_refused():
    with pytest.raises(ConfigError, match="got grey"):
        learn_colour("blue", patch(PAINT["blue"]), 4.0, 4.0)
    with pytest.raises(ConfigError, match="not inside the 40x40 picture"):
        learn_colour("blue", patch(PAINT["blue"]), 39.0, 20.0)
