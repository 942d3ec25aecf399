import numpy as np

from trainer.transfer.unpaired import features, kernel_distance


def pictures(count: int, seed: int, brightness: float = 128.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    noise = rng.normal(brightness, 30.0, (count, 20, 30, 3)) + rng.normal(0, 20, (count, 1, 1, 3))
    return noise.clip(0, 255).astype(np.uint8)


def test_the_features_are_fixed_and_rows_do_not_mix() -> None:
    some = pictures(6, 0)
    rows = features(some)
    np.testing.assert_allclose(features(some[2:3])[0], rows[2], rtol=1e-5, atol=1e-6)
    assert len(np.unique(rows[0])) > 100


def test_distances_grow_with_the_difference() -> None:
    real = features(pictures(60, 0))
    alike, darker, dark = (features(pictures(60, 1, level)) for level in (128.0, 110.0, 80.0))
    near, further, far = (kernel_distance(made, real) for made in (alike, darker, dark))
    assert near < further < far
    assert abs(near) < 0.1 * far


def test_what_rounding_does_to_flat_skies_is_no_distance() -> None:
    rng = np.random.default_rng(0)
    real, other = pictures(60, 0), pictures(60, 1)
    real[:, :10], other[:, :10] = 200, 201
    other[:, :10][rng.random((60, 10, 30)) < 0.5] = 200
    darker = other.copy()
    darker[:, :10] -= 40
    near, far = (kernel_distance(features(made), features(real)) for made in (other, darker))
    assert abs(near) < 0.2
    assert far > 100.0 * abs(near)
