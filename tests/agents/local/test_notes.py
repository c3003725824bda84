"""Notes: what a module says of its rule's, and when."""

from cubepath.agents.local.module import LastNote


def test_there_is_nothing_to_say_before_the_first_choice() -> None:
    """Until the round after that, whatever was said; then zeros, where the rule said nothing."""
    last = LastNote((0, 0), first_choice=3)
    assert [last.sent_in(number) for number in (1, 2, 3, 4, 5)] == [
        None,
        None,
        None,
        (0, 0),
        (0, 0),
    ]


def test_what_was_said_last_is_said_again() -> None:
    """A choice with a note replaces it, one without leaves it."""
    last = LastNote((0, 0), first_choice=1).replaced_by((7, 8))
    assert last.sent_in(2) == (7, 8)
    assert last.sent_in(1) is None
    assert last.replaced_by(None) == last.replaced_by(()) == last
    assert last.replaced_by((1, 2)).sent_in(9) == (1, 2)


def test_a_silent_rule_says_nothing() -> None:
    """Notes of length zero are none."""
    assert LastNote((), first_choice=1).sent_in(5) is None
