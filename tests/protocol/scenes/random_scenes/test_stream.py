"""The stream of random numbers: pinned for good, uniform, and of one purpose and seed."""

from collections import Counter
from hashlib import sha256
from itertools import islice

from chances import as_chance_has_it
from cubepath.protocol.scenes.random_scenes import Stream


def test_the_numbers_are_pinned() -> None:
    """These are the numbers of version 0.1: a seed names the same scene for good."""
    stream = Stream("starts", 7)
    assert [stream.below(limit) for limit in (2, 3, 6, 100, 10**6)] == [0, 2, 0, 84, 6765]
    assert stream.below(10**40) == 4457174603042767583273885048128275295414
    assert list(Stream("goals", 0).drawn(range(10))) == [7, 4, 5, 2, 9, 6, 1, 0, 3, 8]


def test_numbers_are_bits_of_digests() -> None:
    """Bits of the SHA-256 digests in order, most significant first, read again if too large."""
    digests = b"".join(sha256(b"cubepath:some:3:%d" % block).digest() for block in range(40))
    bits = "".join(f"{byte:08b}" for byte in digests)
    stream = Stream("some", 3)
    for limit in (1, 2, 3, 5, 8, 1000, 2**300, 7) * 5:
        size = (limit - 1).bit_length()
        while True:
            number, bits = int(bits[:size] or "0", 2), bits[size:]
            if number < limit:
                break
        assert stream.below(limit) == number


def test_a_choice_of_more_begins_with_the_choice_of_fewer() -> None:
    """So vehicles stay where they start when there are more of them."""
    for seed in range(20):
        some = list(islice(Stream("starts", seed).drawn(range(30)), 4))
        assert list(islice(Stream("starts", seed).drawn(range(30)), 9))[:4] == some
    everything = list(Stream("starts", 1).drawn("abcdef"))
    assert sorted(everything) == list("abcdef")


def test_every_order_is_as_likely() -> None:
    """Over 6000 seeds each of the 24 orders of four comes about as often."""
    found = Counter(tuple(Stream("orders", seed).drawn(range(4))) for seed in range(6000))
    assert len(found) == 24
    assert as_chance_has_it(found.values(), 250)
