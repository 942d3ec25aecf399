import json
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from statistics import stdev

import numpy as np
import pytest

from trainer.experiments.six_models import (
    FIRST_SEED,
    Model,
    SixModelsOptions,
    TransferRow,
    drives,
    gather,
    kinds,
    table_rows,
    trainings,
    trials,
)
from trainer.report.curves import half_interval

OPTIONS = SixModelsOptions(translator="gan.onnx", look="nominal", seeds=2)


def models(options: SixModelsOptions) -> list[Model]:
    """In the order in which they are trained."""
    return [model for among in zip(*kinds(options), strict=True) for model in among]


def test_every_model_has_its_first_seed_before_any_has_its_second():
    seeds = [model.seed for model in models(OPTIONS)]
    assert seeds == sorted(seeds)
    assert len(set(models(OPTIONS)[:8])) == 8


def test_six_models_without_a_translator_are_four():
    ways = {(m.algorithm, m.variant) for m in models(OPTIONS)}
    assert len(ways) == 8  # the paper's six, and both ways together
    without = {(m.algorithm, m.variant) for m in models(replace(OPTIONS, translator=None))}
    assert without == {way for way in ways if "cyclegan" not in way[1]}


def test_all_models_are_trained_alike_but_for_what_is_compared(tmp_path):
    jobs = [
        job
        for job in trainings(tmp_path, OPTIONS, models(OPTIONS))
        if job.options.task == "navigation"
    ]
    assert len({job.out for job in jobs}) == len(jobs) == 16
    alike = {
        (job.options.algo, repr(replace(job.options, algo="", look="", translate=None, seed=0)))
        for job in jobs
    }
    assert len(alike) == 2  # one for each algorithm
    assert {job.options.steps for job in jobs} == {OPTIONS.steps, OPTIONS.ppo_steps}
    ways = Counter((job.options.look, job.options.translate) for job in jobs)
    assert ways == {
        ("nominal", None): 4,
        ("randomised", None): 4,
        ("nominal", "gan.onnx"): 4,
        ("randomised", "gan.onnx"): 4,
    }
    assert OPTIONS.test_map not in jobs[0].options.map


def test_judged_in_reality_and_with_the_arenas_pose_error_and_nowhere_else(tmp_path):
    """By default, and written into the file that each test leaves."""
    options = SixModelsOptions(translator="gan.onnx", seeds=2)
    judged = Counter()
    for job in drives(tmp_path, options, models(options)):
        assert job.options.look == "reality"
        asked = job.options.filled_in("lane")
        assert asked.look == "reality"
        assert asked.map == (("loop",) if asked.task == "four_laps" else ("arena",))
        judged[asked.task, asked.pose_error] += 1
    assert judged == {
        ("four_laps", None): 16,
        ("manoeuvres", "arena"): 16,
        ("navigation", "arena"): 16,
    }
    for training in trainings(tmp_path, options, models(options)):
        config = training.options.config() if training.options.translate is None else None
        assert training.options.look in ("nominal", "randomised")
        assert not training.options.judge_look  # nor is anything chosen there
        assert config is None or config.evaluation.look == ""


def test_every_model_is_judged_by_its_own_run_untranslated(tmp_path):
    runs = {job.out: job.options for job in trainings(tmp_path, OPTIONS, models(OPTIONS))}
    for job in drives(tmp_path, OPTIONS, models(OPTIONS)):
        assert job.out.parent in runs
        assert job.options.model == str(job.out.parent / "model.onnx")
        assert job.options.translate is None
        laps = job.options.task == "four_laps"
        assert runs[job.out.parent].task == ("lane" if laps else "navigation")
    assert FIRST_SEED % 160 == 0


def test_the_tables_count_successes_and_judge_as_the_paper(tmp_path):
    for k, model in enumerate(models(OPTIONS)):
        for name, trial in trials(OPTIONS).items():
            file = model.judged(tmp_path, name)
            file.parent.mkdir(exist_ok=True)
            file.write_text(json.dumps({"episodes": trial.episodes, "failures": list(range(k))}))
    found = gather(tmp_path, OPTIONS)
    assert [row.paths for row in found[:2]] == [(32, 24), (31, 23)]
    assert found[-1].tasks == (43, 35)
    assert len(table_rows(found, {"laps": 20, "paths": 32, "tasks": 50})) == 1 + 8


def test_seeds_have_an_interval_by_students_t():
    assert half_interval(np.array([1.0, 2.0, 3.0])) == pytest.approx(2.484, abs=1e-3)
    assert half_interval(np.array([5.0, 5.0])) == 0.0
    spread = [half_interval(np.arange(n)) / stdev(range(n)) * n**0.5 for n in range(2, 30)]
    assert all(fewer >= more - 1e-9 for fewer, more in pairwise(spread))
    assert spread[-1] > 1.96


@pytest.mark.parametrize(
    ("paths", "verdict"),
    [((21, 32, 30), "success"), ((20, 20, 32), "neither"), ((9, 0, 32), "failure")],
)
def test_the_verdict_is_of_the_median_model(paths, verdict):
    assert TransferRow("ppo", "dr", (), paths, ()).verdict == verdict
