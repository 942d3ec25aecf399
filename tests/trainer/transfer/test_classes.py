import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_pybullet.scene import SemanticClass
from trainer.transfer.labelled import LABEL_SETS, VOID, LabelSet
from trainer.transfer.parser import score_classes

SETS = pytest.mark.parametrize("labels", LABEL_SETS.values(), ids=str)


@SETS
def test_every_class_of_the_simulator_has_a_place(labels: LabelSet) -> None:
    assert len(labels.of_simulator) == len(SemanticClass)
    assert max(labels.of_simulator) < len(labels.classes)
    assert len(labels.colours) == len(set(labels.colours)) == len(labels.classes)


@SETS
def test_a_painted_picture_reads_back_even_when_its_colours_are_a_little_off(
    labels: LabelSet,
) -> None:
    classes = np.arange(len(labels.classes), dtype=np.uint8).reshape(1, -1)
    noise = np.random.default_rng(0).integers(-10, 11, (20, *classes.shape, 3))
    picture = np.clip(labels.paint(classes) + noise, 0, 255).astype(np.uint8)
    assert np.array_equal(labels.read(picture), np.repeat(classes[None], 20, 0))


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 5)), min_size=1, max_size=60))
def test_scores_are_those_of_the_definition(pairs: list[tuple[int, int]]) -> None:
    truth = np.array([VOID if t == 6 else t for t, _ in pairs], np.uint8)
    guess = np.array([g for _, g in pairs], np.uint8)
    if (truth == VOID).all():
        return
    labels = LABEL_SETS["road"]
    result = score_classes(truth, guess, labels)
    counted = truth != VOID
    assert result.pixel_accuracy == pytest.approx((truth == guess)[counted].mean())
    for k, row in enumerate(result.classes):
        union = ((truth == k) | (guess == k)) & counted
        both = (truth == k) & (guess == k)
        if (truth == k).any():
            assert row.iou == pytest.approx(both.sum() / union.sum())
        else:
            assert np.isnan(row.iou)
