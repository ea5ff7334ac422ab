"""Statements of the paper are judged by tests and intervals, and what cannot be judged is said to be so."""

from __future__ import annotations

from dataclasses import replace

import pytest

from flows.conditions import defaults
from flows.runs import load_runs
from juicer.reporting.analyses import AnalysisRow
from juicer.reporting.content import ShownAnalysis
from juicer.reporting.paper import PAPER_TABLE_VI
from juicer.reporting.report import gather
from juicer.reporting.setting import Setting
from juicer.study.claims import CLAIMS, OWN_CLAIMS, claims_section
from juicer.study.curves import Curve
from juicer.study.rules import AtMost, Best, BestWithin, Better, ModelsDiffer, Ruling, SampledAlike, Saturates
from juicer.study.success import success_section
from tests.study.conftest import Made


def share_curve(**points):
    return Curve(name="synthetic_share", title="Share", axis="share", fit="none", points=points)


@pytest.mark.parametrize(
    ("bc", "ta", "ruling"),
    [
        ((0.5, 0.5, 0.5), (0.8, 0.8, 0.8), Ruling.HOLDS),
        ((0.8, 0.8, 0.8), (0.5, 0.5, 0.5), Ruling.FAILS),
        ((0.5, 0.5, 0.5), (0.53, 0.5, 0.52), Ruling.OPEN),
        # The pooled episodes differ beyond doubt, the recipes do not: one seed alone is better.
        ((0.5, 0.5, 0.5), (0.5, 0.5, 0.98), Ruling.OPEN),
    ],
)
def test_a_condition_is_better_if_episodes_and_models_both_say_so(study, result, bc, ta, ruling):
    verdict = Better("ta", "bc").judge(study(result("bc", *bc), result("ta", *ta)))
    assert verdict.ruling is ruling
    assert "TA against BC" in verdict.reason


def test_conditions_from_other_initial_states_are_not_compared(study, result):
    tried = study(result("bc", 0.2), result("ta", 0.9), settings={"ta": "randomness med"})
    assert Better("ta", "bc").judge(tried).ruling is Ruling.UNTESTED
    assert Best("ta", ("bc",)).judge(tried).ruling is Ruling.UNTESTED


def test_what_differs_in_more_than_its_method_is_compared_only_by_a_statement_about_that(study, result):
    many = study(result("bc", 0.2, 0.2), result("ta", 0.9, 0.9))
    many.measured["ta"] = replace(many.measured["ta"], setting=Setting(changes="record.demonstrations 500"))
    verdict = Better("ta", "bc").judge(many)
    assert verdict.ruling is Ruling.UNTESTED
    assert verdict.reason == (
        "the statement is about methods alone, and more is changed (TA: record.demonstrations 500)"
    )
    assert Best("ta", ("bc",)).judge(many).ruling is Ruling.UNTESTED
    assert Better("ta", "bc", settings=True).judge(many).ruling is Ruling.HOLDS


def test_conditions_that_change_the_same_are_not_judged_as_those_of_the_paper(study, result):
    names = ("bc", "ta", "mlp_unchunked")
    alike = study(*(result(name, 0.0, 0.0, 0.0) for name in names), settings=dict.fromkeys(names, "randomness med"))
    for rule in (Better("ta", "bc"), Best("ta", ("bc",)), AtMost("mlp_unchunked", 0.05), ModelsDiffer("bc")):
        verdict = rule.judge(alike)
        assert verdict.ruling is Ruling.UNTESTED
        assert "randomness med" in verdict.reason


def test_what_conditions_are_based_on_is_told_beside_the_papers(made):
    config = {"task": "one_leg", "randomness": "med"}
    data = made.artifact("ingest", "episodes", config=config, summary={"episodes": 10})
    for name in ("bc", "ta"):
        checkpoint = made.artifact("train", "checkpoint", inputs={"episodes": (data,)}, config={"name": name})
        made.evaluation(name, checkpoint, randomness="med")
    claims, rates = claims_section([made.study]), success_section([made.study])
    assert claims.note.endswith(
        "of 50 demonstrations at low randomness; what changes nothing here is of 10 demonstrations, randomness med "
        "(one_leg)."
    )
    assert rates.tables[0].note == "10 demonstrations, randomness med"


def test_tasks_that_are_based_on_the_same_are_told_together(tmp_path):
    studies = []
    for task in ("one_leg", "lamp"):
        made = Made(tmp_path / "store", task)
        data = made.artifact("ingest", "episodes", config={"task": task}, summary={"episodes": 50})
        for name in ("bc", "ta"):
            checkpoint = made.artifact("train", "checkpoint", inputs={"episodes": (data,)}, config={"name": name})
            made.evaluation(name, checkpoint, randomness="low")
        studies.append(made.study)
    assert claims_section(studies).note.endswith("here is of 50 demonstrations, randomness low (one_leg, lamp).")


def test_a_setting_with_a_name_is_a_heading_and_spelled_out_below(made):
    few = "randomness med, record.demonstrations 10"
    for name in ("ten_bc", "ten_ta"):
        checkpoint = made.artifact("train", "checkpoint", config={"name": name})
        made.evaluation(name, checkpoint, setting=few, named="10 demonstrations")
    (table,) = success_section([made.study]).tables
    assert (table.title, table.note) == ("one_leg, 10 demonstrations", few)
    assert [row[0] for row in table.rows] == ["TEN_BC", "TEN_TA"]


def test_conditions_that_change_alike_stand_together_whether_their_setting_is_named_or_not(made):
    for name, named in (("ten_bc", "10 demonstrations"), ("ten_ta", "")):
        checkpoint = made.artifact("train", "checkpoint", config={"name": name})
        made.evaluation(name, checkpoint, setting="record.demonstrations 10", named=named)
    (table,) = success_section([made.study]).tables
    assert [row[0] for row in table.rows] == ["TEN_BC", "TEN_TA"]


def test_the_papers_figures_stand_beside_conditions_that_change_nothing_alone(made):
    for name, setting in (("bc", ""), ("ta", "randomness med")):
        made.evaluation(name, made.artifact("train", "checkpoint", config={"name": name}), setting=setting)
    results = [each.result for each in made.study.measured.values()]
    told = gather(made.study.sources, results, title="t", task="one_leg", facts={}, findings=())
    assert set(told.paper) == {"bc"}


@pytest.mark.parametrize("changed", [{"first": 100}, {"max_steps": 5}])
def test_episodes_of_other_states_or_of_another_length_are_not_compared(made, changed):
    for name, settings in (("bc", {}), ("ta", changed)):
        made.evaluation(name, made.artifact("train", "checkpoint", config={"name": name}), **settings)
    verdict = Better("ta", "bc", settings=True).judge(made.study)
    assert verdict.ruling is Ruling.UNTESTED
    assert verdict.reason == "their episodes start from different states, or may take longer"


def test_policies_that_see_different_things_are_not_compared(result, study):
    told, seeing = result("bc", 0.3), replace(result("ta", 0.9), observes="images")
    assert Better("ta", "bc").judge(study(told, seeing)).reason == "their policies do not see the same"


@pytest.mark.parametrize(
    ("bc", "ta", "ruling", "why"),
    [
        ((0.6, 0.6, 0.6), (0.6, 0.6, 0.6), Ruling.FAILS, "; if it is better at all, then by no more than 3 points"),
        ((1.0, 1.0, 0.99), (1.0, 1.0, 1.0), Ruling.OPEN, "; BC leaves no room to be better"),
        ((0.6, 0.6, 0.6), (0.65, 0.6, 0.62), Ruling.OPEN, ""),
    ],
)
def test_a_method_that_is_as_good_at_most_does_not_help(study, result, bc, ta, ruling, why):
    first, second = result("bc", *bc, episodes=1000), result("ta", *ta, episodes=1000)
    if bc == ta:
        # The same episodes succeed, so nothing is left to chance.
        second = replace(second, models=first.models)
    verdict = Better("ta", "bc").judge(study(first, second))
    assert verdict.ruling is ruling
    assert verdict.reason.partition(", p ")[2].partition(";")[2] == why.removeprefix(";")


def test_what_has_no_result_is_not_tested_and_the_missing_condition_is_named(study, result):
    verdict = Better("ta", "bc").judge(study(result("bc", 0.5)))
    assert (verdict.ruling, verdict.reason) == (Ruling.UNTESTED, "no result of ta")


def test_the_best_is_above_each_of_the_others(study, result):
    low, middle, high = result("bc", 0.3, 0.3), result("ta", 0.8, 0.8), result("ta_ci", 0.98, 0.98)
    rule = Best("ta_ci", ("bc", "ta"))
    assert rule.judge(study(low, middle, high)).ruling is Ruling.HOLDS
    assert rule.judge(study(low, result("ta", 0.96, 0.96), high)).ruling is Ruling.OPEN
    assert rule.judge(study(low, result("ta", 1.0, 1.0), result("ta_ci", 0.7, 0.7))).ruling is Ruling.FAILS


def test_the_best_is_not_told_without_all_of_the_others(study, result):
    low, high = result("bc", 0.3, 0.3), result("ta_ci", 0.9, 0.9)
    elsewhere = result("ta", 0.99, 0.99)
    elsewhere = replace(elsewhere, models=tuple(replace(each, seed=each.seed + 7) for each in elsewhere.models))
    verdict = Best("ta_ci", ("bc", "ta")).judge(study(low, elsewhere, high))
    assert (verdict.ruling, verdict.reason) == (Ruling.UNTESTED, "TA_CI has no seed in common with TA")


def test_of_one_model_each_nothing_is_told_of_their_recipes(study, result):
    verdict = Better("ta", "bc").judge(study(result("bc", 0.2), result("ta", 0.9)))
    assert verdict.ruling is Ruling.OPEN
    assert verdict.reason.endswith("of one seed, where two at least must tell how far trainings differ")


def test_statements_are_of_tasks_on_which_the_papers_own_averages_agree_with_them():
    for claim in CLAIMS:
        if claim.source != "Table VI":
            continue
        for averages in ({name: low for name, (low, _) in PAPER_TABLE_VI[task].items()} for task in claim.tasks):
            if isinstance(claim.rule, Better):
                assert averages[claim.rule.better] > averages[claim.rule.than], claim.sentence
            if isinstance(claim.rule, Best):
                assert averages[claim.rule.best] > max(averages[name] for name in claim.rule.among), claim.sentence


def sampled(title, **apart):
    shown = ShownAnalysis("fig4", "", apart={steps.lstrip("n"): each for steps, each in apart.items()})
    return AnalysisRow(name="fig4", condition="bc", title=title, seed=0), shown


@pytest.mark.parametrize(
    ("apart", "ruling"),
    [
        ((0.08,), Ruling.HOLDS),
        ((0.12,), Ruling.OPEN),  # chance alone may have added that
        ((0.3,), Ruling.FAILS),
        ((0.08, 0.3), Ruling.OPEN),
        ((), Ruling.UNTESTED),
    ],
)
def test_few_steps_of_the_sampler_do_if_their_samples_are_as_those_of_many(study, result, apart, ruling):
    analyses = tuple(sampled(f"BC {number}", n8=each, chance=0.03) for number, each in enumerate(apart))
    other = AnalysisRow(name="modes", condition="bc", title="BC", seed=0), ShownAnalysis("modes", "")
    told = replace(study(result("bc", 0.5)), analyses=(other, *analyses))
    verdict = SampledAlike(8, within=0.1).judge(told)
    assert verdict.ruling is ruling
    assert all(
        f"BC {number}, seed 0: {each:.2f} (chance alone 0.03)" in verdict.reason for number, each in enumerate(apart)
    )


def test_a_statement_about_samples_is_judged_once_whatever_conditions_change(study, result):
    told = study(result("bc", 0.5), result("med_bc", 0.4), settings={"med_bc": "randomness med"})
    told = replace(told, analyses=(sampled("BC, med", n8=0.05, chance=0.03),))
    (rows, *others) = claims_section([told]).tables
    assert [row[3] for row in rows.rows if "Eight steps" in row[0]] == ["holds"]
    assert not any("Eight steps" in row[0] for table in others for row in table.rows)


def test_never_means_that_the_interval_stays_below_a_bound(study, result):
    rule = AtMost("mlp_unchunked", 0.05)
    assert rule.judge(study(result("mlp_unchunked", 0.0, 0.0))).ruling is Ruling.HOLDS
    assert rule.judge(study(result("mlp_unchunked", 0.04, 0.04))).ruling is Ruling.OPEN
    assert rule.judge(study(result("mlp_unchunked", 0.94, 0.94))).ruling is Ruling.FAILS
    assert rule.judge(study(result("mlp_unchunked", 0.94))).ruling is Ruling.OPEN, "other trainings may differ"


def test_models_differ_only_if_there_are_enough_of_them_and_not_by_chance(study, result):
    rule = ModelsDiffer("bc")
    assert rule.judge(study(result("bc", 0.2, 0.9))).ruling is Ruling.UNTESTED
    assert rule.judge(study(result("bc", 0.3, 0.5, 0.9))).ruling is Ruling.HOLDS
    assert rule.judge(study(result("bc", 0.5, 0.52, 0.49))).ruling is Ruling.OPEN
    ended_early = rule.judge(study(replace(result("bc", 0.3, 0.5, 0.9), anytime=True)))
    assert ended_early.ruling is Ruling.OPEN
    assert "ended when something was settled" in ended_early.reason


def test_a_curve_saturates_where_its_fit_says_so(study, result):
    rates = {10: 0.3, 20: 0.5, 40: 0.7, 80: 0.8, 160: 0.8}
    curve = Curve(name="own_rollouts", title="O", axis="o", fit="saturating", points={f"own_{x}": x for x in rates})
    tried = study(*(result(f"own_{x}", rate, rate, rate) for x, rate in rates.items()), curves=(curve,))
    assert Saturates("own_rollouts", 500).judge(tried).ruling is Ruling.HOLDS
    assert Saturates("own_rollouts", 20).judge(tried).ruling is Ruling.FAILS
    assert Saturates("elsewhere", 20).judge(tried).ruling is Ruling.UNTESTED


def test_where_a_curve_saturates_outside_its_points_cannot_be_told(study, result):
    rates = {10: 0.05, 20: 0.1, 40: 0.2, 80: 0.4}
    curve = Curve(name="own_rollouts", title="O", axis="o", fit="saturating", points={f"own_{x}": x for x in rates})
    tried = study(*(result(f"own_{x}", rate, rate, rate, episodes=2000) for x, rate in rates.items()), curves=(curve,))
    verdict = Saturates("own_rollouts", 20).judge(tried)
    assert verdict.ruling is Ruling.OPEN
    assert "which lies beyond the points" in verdict.reason


def test_a_curve_that_begins_at_its_plateau_saturates_by_any_later_number(study, result):
    rates = {50: 0.81, 100: 0.85, 200: 0.85, 400: 0.85, 800: 0.85}
    curve = Curve(name="own_rollouts", title="O", axis="o", fit="saturating", points={f"own_{x}": x for x in rates})
    tried = study(*(result(f"own_{x}", rate, rate, rate) for x, rate in rates.items()), curves=(curve,))
    assert Saturates("own_rollouts", 500).judge(tried).ruling is Ruling.HOLDS


def test_an_optimum_lies_within_bounds_if_nothing_outside_may_be_as_good(study, result):
    rule, curve = BestWithin("synthetic_share", 0.08, 0.2), share_curve(bc=0, ten=0.1, forty=0.4)

    def ruling(ten, forty):
        results = (result("bc", 0.4, 0.4), result("ten", ten, ten), result("forty", forty, forty))
        return rule.judge(study(*results, curves=(curve,))).ruling

    assert ruling(0.9, 0.5) is Ruling.HOLDS
    assert ruling(0.9, 0.88) is Ruling.OPEN
    assert ruling(0.5, 0.9) is Ruling.FAILS
    outside = study(result("bc", 0.4, 0.4), result("forty", 0.9, 0.9), curves=(curve,))
    assert rule.judge(outside).ruling is Ruling.UNTESTED, "nothing was measured inside"
    alone = study(result("bc", 0.4), result("ten", 0.9), result("forty", 0.5), curves=(curve,))
    assert rule.judge(alone).ruling is Ruling.OPEN


def test_each_statement_is_told_with_its_verdict_and_the_reason(study, result):
    section = claims_section([study(result("bc", 0.4, 0.4), result("ta", 0.8, 0.8))])
    assert section is not None
    judged, untested = section.tables
    assert [row[:4] for row in judged.rows] == [
        ("Corrective snippets help: TA beats BC.", "Table VI", "one_leg", "holds")
    ]
    assert len(judged.rows) + len(untested.rows) == sum("one_leg" in claim.tasks for claim in CLAIMS)
    assert untested.folded
    assert "no result of ci" in {why for *_, why in untested.rows}
    assert section.note.startswith("Holds: 1, not tested: ")


def test_statements_of_ours_stand_by_themselves(study, result):
    names, setting = ("ten_coverage_96", "ten_ta_96"), ("coverage", "uniform")
    alike = study(result(names[0], 0.8, 0.8), result(names[1], 0.4, 0.4))
    measured = {
        name: replace(alike.measured[name], setting=Setting(changes=each))
        for name, each in zip(names, setting, strict=True)
    }
    own, _ = claims_section([replace(alike, measured=measured)]).tables
    assert own.title == "Statements that the paper does not make"
    assert [row[0] for row in own.rows] == ["96 snippets placed by coverage help more than 96 drawn uniformly."]
    assert own.rows[0][3] == "holds"


def test_nothing_is_told_of_statements_none_of_which_was_tested(study, result):
    assert claims_section([study(result("my_own", 0.4))]) is None


def test_what_statements_compare_is_in_the_papers_study():
    (one_leg, *_) = load_runs("paper_study")
    assert set(one_leg.conditions) >= set(defaults()["conditions"])
    for claim in (*CLAIMS, *OWN_CLAIMS):
        for name in ("better", "than", "best", "condition"):
            assert getattr(claim.rule, name, "bc") in one_leg.conditions
        assert set(getattr(claim.rule, "among", ())) <= set(one_leg.conditions)
        assert getattr(claim.rule, "curve", "rounds") in one_leg.curves


def test_statements_are_judged_where_more_is_changed_as_well(study, result):
    human = "record.temperament.kind human"
    names = {"human_bc": "bc", "human_mlp_chunked": "mlp_chunked", "human_mlp_unchunked": "mlp_unchunked", "own": ""}
    results = [result(name, *rates) for name, rates in zip(names, RATES_OF_HUMANS, strict=True)]
    known = study(*results, settings=dict.fromkeys(names, human))
    known = replace(known, measured={name: replace(each, method=names[name]) for name, each in known.measured.items()})
    table = next(table for table in claims_section([known]).tables if "where it was tested as well" in table.columns)
    told = {sentence: (setting, verdict) for sentence, _, setting, verdict, _ in table.rows}
    assert told["Without action chunks nothing is assembled."] == (human, "holds")
    assert told["Predicting chunks of actions helps."] == (human, "holds")
    assert "Corrective snippets help: TA beats BC." not in told


RATES_OF_HUMANS = ((0.8, 0.82, 0.81), (0.6, 0.62, 0.61), (0.0, 0.0, 0.0), (0.5, 0.5, 0.5))
