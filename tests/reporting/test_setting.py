"""Settings are what conditions change, under a name that shapes nothing."""

from __future__ import annotations

from juicer.reporting.setting import Setting


def test_settings_of_the_same_changes_are_equal_whatever_they_are_called():
    assert Setting("rounds 2", "few rounds") == Setting("rounds 2")
    assert Setting("rounds 2", "few rounds") != Setting("rounds 3", "few rounds")


def test_changes_are_spelled_out_only_where_a_name_is_read_instead():
    for plain in (Setting(), Setting("rounds 2"), Setting().within("as in other"), Setting("rounds 2").within("x")):
        assert plain.spelled_out == ""
    named = Setting("rounds 2", "few rounds").within("as in other")
    assert (str(named), named.spelled_out) == ("as in other, few rounds", "as in other, rounds 2")
    assert str(Setting("rounds 2").within("as in other")) == "as in other, rounds 2"
    assert str(Setting().within("as in other")) == "as in other"
