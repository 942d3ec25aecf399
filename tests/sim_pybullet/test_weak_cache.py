import gc

from sim_pybullet.weak_cache import WeakCache


class Owner:
    __hash__ = None  # type: ignore[assignment]


def test_a_value_is_made_once_per_owner_and_key_and_dies_with_the_owner() -> None:
    cache: WeakCache[object] = WeakCache()
    first, second = Owner(), Owner()
    value = cache.get(first, "a", object)
    assert cache.get(first, "a", object) is value
    assert cache.get(first, "b", object) is not value
    assert cache.get(second, "a", object) is not value
    assert len(cache) == 2
    del first
    gc.collect()
    assert len(cache) == 1
