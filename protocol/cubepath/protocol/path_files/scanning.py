"""Scanning self-contained moves, compiled: from the bytes of lines to numbers of texts and sites.

What two lines have in common is found from their bytes alone, without a Python object for either.
The contents of a line are its lists as they are written; each distinct text of contents has a
number, and so has each distinct text of a site. What a site's text means is not decided here, nor
whether it is JSON: `cubepath.protocol.path_files.contents` decodes each once. Here only the
structure around it is checked. Hashes only find texts, and are always followed by a comparison.

Each function stops at a newline, which every line has at its end and no valid JSON text contains.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.sites import DEPTH_MAX

Bytes = NDArray[np.uint8]
Numbers = NDArray[np.int32]
Totals = NDArray[np.int64]

# Entries of `totals`: how much of each array is in use.
MOVES, TEXTS, TEXT_BYTES, SITES, SITE_BYTES, MENTIONS, ID_BYTES = 0, 1, 2, 3, 4, 5, 6
TOTALS = 7

_NEWLINE, _SPACE, _TAB, _RETURN, _QUOTE, _COMMA, _COLON = 10, 32, 9, 13, 34, 44, 58
_OPEN, _BACKSLASH, _CLOSE, _BEGIN, _END = 91, 92, 93, 123, 125
_ID, _TRACE = 0, 2
_KEYS = b'id"support"trace"before"after"'
_KEY_AT = (0, 3, 11, 17, 24, 30)
"""Where each key begins in these, with the quote behind it, and where the last one ends."""
PROBES = 256
"""Places that a search for a text looks at before it gives up.

More happens only where somebody chose the texts for their hashes."""
_MASK, _LOW = 0xFFFFFFFF, 0x7FFFFFFF
_BASIS, _FACTOR = 2166136261, 739982445

at = np.uint64
"""An index that is never negative: without a check for counting from the end, loops are vectors."""


class Texts(NamedTuple):
    """The distinct texts so far; arrays may be longer than the part in use, as `totals` tells.

    For each text of contents, `rows` holds where it begins in `arena` and the length of each of its
    four parts (support, trace, before, after; for a move that its id names: support, trace, id, and
    -1), `first` the move where it came first, and `parts_at` where the sites of each part begin in
    `mentions` (one more at the end), which are numbers of site texts. Site text n is
    ``site_arena[site_at[n]:site_at[n + 1] - 1]``, and a comma follows it. `slots` and `site_slots`
    are open hash tables of a power of two of places: each a hash of 31 bits, and below it in 32
    bits the number plus one, or 0 where there is nothing.
    """

    slots: Totals
    rows: Totals
    arena: Bytes
    first: Numbers
    parts_at: Numbers
    mentions: Numbers
    site_slots: Totals
    site_arena: Bytes
    site_at: Totals
    totals: Totals


# Arrays are taken out of the tuple once, and few calls take it: each counts references to all.
@compiled
def scan(  # noqa: C901, PLR0911, PLR0912, PLR0915, PLR0917 - see above
    text: Bytes, ends: Totals, line: int, texts: Texts, moves: Numbers, ids: Bytes, value: Totals
) -> int:
    """Scan lines from `line` on; return the line where it stopped, or minus one minus it if odd.

    Line i ends with the newline at ``ends[i]``. It stops at the end of the lines, or where there
    is no room for another. `moves` receives the number of the contents of each line, -1 for a blank
    one, and `ids` their ids as text, each followed by a comma. A line that is no self-contained
    move in its plain form is odd. `value` has room for where the values of the five keys begin and
    end.
    """
    slots, rows, arena, totals = texts.slots, texts.rows, texts.arena, texts.totals
    arena_size, rows_size, sites_size = len(arena), len(rows), len(texts.site_at)
    site_arena_size, mentions_size = len(texts.site_arena), len(texts.mentions)
    mask, site_mask = len(slots) - 1, len(texts.site_slots) - 1
    while line < len(ends):
        place = 0 if line == 0 else ends[line - 1] + 1
        stop = ends[line]
        size = stop - place
        if (
            totals[TEXT_BYTES] + size > arena_size
            or totals[SITE_BYTES] + size > site_arena_size
            or totals[MENTIONS] + size > mentions_size
            or totals[TEXTS] + 1 >= rows_size
            or 2 * (totals[TEXTS] + 1) > mask
            or totals[SITES] + size + 1 >= sites_size
            or 2 * (totals[SITES] + size) > site_mask
        ):
            return line
        place = _blank(text, place)
        if place == stop:
            moves[line] = -1
            line += 1
            continue
        if text[at(place)] != _BEGIN:
            return -1 - line
        for key in range(10):
            value[key] = 0
        place += 1
        while True:
            place = _blank(text, place)
            key = _key(text, place)
            if key < 0 or value[2 * key + 1] != 0:
                return -1 - line
            place += 1 + _KEY_AT[key + 1] - _KEY_AT[key]
            place = _blank(text, place)
            if text[at(place)] != _COLON:
                return -1 - line
            place = _blank(text, place + 1)
            value[2 * key] = place
            if key != _ID:
                place = _list(text, place)
            elif text[at(place)] == _QUOTE:
                place = _string(text, place)
            else:
                place = _word(text, place)
            if place < 0 or place == value[2 * key]:
                return -1 - line
            value[2 * key + 1] = place
            place = _blank(text, place)
            if text[at(place)] == _COMMA:
                place += 1
            elif text[at(place)] == _END:
                break
            else:
                return -1 - line
        if _blank(text, place + 1) != stop:
            return -1 - line
        if value[1] == 0 or value[3] == 0 or value[5] == 0 or (value[7] == 0) != (value[9] == 0):
            return -1 - line
        up, size = totals[ID_BYTES], value[1] - value[0]
        for index in range(size):
            ids[at(up + index)] = text[at(value[0] + index)]
        ids[at(up + size)] = _COMMA
        totals[ID_BYTES] = up + size + 1
        if value[7] == 0:
            # Without local states the id is part of the contents.
            value[6], value[7] = value[0], value[1]
        hashed = _BASIS
        for part in range(1, 5):
            hashed = _hash(text, value[2 * part], value[2 * part + 1], hashed + part)
        slot = hashed & mask
        found = -1
        for _ in range(PROBES):
            here = slots[at(slot)]
            if here == 0:
                found = _new_contents(text, value, texts, hashed, slot)
                break
            if here >> 32 == hashed:
                number = (here & _MASK) - 1
                place = rows[number, 0]
                differs = 0
                for part in range(1, 5):
                    begin, size = value[2 * part], value[2 * part + 1] - value[2 * part]
                    differs |= rows[number, part] ^ (size if value[2 * part + 1] else -1)
                    if differs == 0:
                        for index in range(size):
                            differs |= text[at(begin + index)] ^ arena[at(place + index)]
                        place += size
                if differs == 0:
                    found = number
                    break
            slot = (slot + 1) & mask
        if found < 0:
            return -1 - line
        moves[line] = found
        totals[MOVES] += 1
        line += 1
    return line


@compiled
def _blank(text: Bytes, place: int) -> int:
    """Return the first place from here on that is no white space within a line."""
    while text[at(place)] == _SPACE or text[at(place)] == _TAB or text[at(place)] == _RETURN:
        place += 1
    return place


@compiled
def _key(text: Bytes, place: int) -> int:
    """Return which key stands here in quotes, -1 if none of the five as it is usually written."""
    if text[at(place)] == _QUOTE:
        for key in range(5):
            index, end = _KEY_AT[key], _KEY_AT[key + 1]
            shift = place + 1 - index
            # Each comparison fails at the end of the line at the latest.
            while index < end and text[at(shift + index)] == _KEYS[index]:
                index += 1
            if index == end:
                return key
    return -1


@compiled
def _string(text: Bytes, place: int) -> int:
    """Return the place after the string whose quote stands here, -1 if it does not end."""
    place += 1
    while text[at(place)] != _QUOTE:
        if text[at(place)] == _BACKSLASH:
            place += 1
        if text[at(place)] < _SPACE:
            return -1
        place += 1
    return place + 1


@compiled
def _word(text: Bytes, place: int) -> int:
    """Return the place after a number or a word that begins here."""
    while True:
        one = text[at(place)]
        if one <= _SPACE or one in (_COMMA, _QUOTE, _COLON, _OPEN, _CLOSE, _BEGIN, _END):
            return place
        place += 1


@compiled
def _list(text: Bytes, place: int) -> int:
    """Return the place after the list that begins here, -1 if it does not end or has an object.

    Only its brackets and strings are looked at.
    """
    if text[at(place)] != _OPEN:
        return -1
    deep = 0
    while True:
        one = text[at(place)]
        if one == _OPEN:
            deep += 1
            if deep > DEPTH_MAX:
                return -1
        elif one == _CLOSE:
            deep -= 1
            if deep == 0:
                return place + 1
        elif one == _QUOTE:
            place = _string(text, place)
            if place < 0:
                return -1
            continue
        elif one in (_NEWLINE, _BEGIN, _END):
            return -1
        place += 1


@compiled
def _hash(text: Bytes, begin: int, end: int, found: int) -> int:
    """Return a hash of 31 bits of a text, continued from another; within 63 bits all the way."""
    place = begin
    while place + 4 <= end:
        four = (
            text[at(place)]
            | text[at(place + 1)] << 8
            | text[at(place + 2)] << 16
            | text[at(place + 3)] << 24
        )
        found = ((found ^ four) & _MASK) * _FACTOR
        found = (found ^ found >> 29) & _MASK
        place += 4
    while place < end:
        found = ((found ^ text[at(place)]) & _MASK) * _FACTOR
        found = (found ^ found >> 29) & _MASK
        place += 1
    return (found ^ found >> 15) & _LOW


@compiled
def _new_contents(  # noqa: C901, PLR0912, PLR0915 - as `scan`
    text: Bytes, value: Totals, texts: Texts, hashed: int, slot: int
) -> int:
    """Add the contents of a line and the sites in them; return their number, -1 if odd."""
    totals, arena, mentions = texts.totals, texts.arena, texts.mentions
    site_slots, site_arena, site_at = texts.site_slots, texts.site_arena, texts.site_at
    number, up, mentioned = totals[TEXTS], totals[TEXT_BYTES], totals[MENTIONS]
    sites, site_up = totals[SITES], totals[SITE_BYTES]
    mask = len(site_slots) - 1
    texts.slots[slot] = hashed << 32 | (number + 1)
    texts.rows[number, 0] = up
    texts.first[number] = totals[MOVES]
    named = value[9] == 0
    for part in range(1, 5):
        begin, end = value[2 * part], value[2 * part + 1]
        texts.rows[number, part] = end - begin if end else -1
        for index in range(end - begin):
            arena[at(up + index)] = text[at(begin + index)]
        up += end - begin
        texts.parts_at[4 * number + part - 1] = mentioned
        if named and part > _TRACE:
            continue
        place = _blank(text, begin + 1)
        more = place < end - 1
        while more:
            start = place
            if text[place] == _QUOTE:
                place = _string(text, place)
            elif text[place] == _OPEN:
                place = _list(text, place)
            else:
                place = _word(text, place)
            if place < 0 or place == start:
                return -1
            size = place - start
            known = _hash(text, start, place, _BASIS)
            spot = known & mask
            found = -1
            for _ in range(PROBES):
                here = site_slots[at(spot)]
                if here == 0:
                    found = sites
                    site_slots[spot] = known << 32 | (sites + 1)
                    for index in range(size):
                        site_arena[at(site_up + index)] = text[at(start + index)]
                    site_arena[site_up + size] = _COMMA
                    site_up += size + 1
                    sites += 1
                    site_at[sites] = site_up
                    break
                if here >> 32 == known:
                    site = (here & _MASK) - 1
                    first = site_at[site]
                    differs = site_at[site + 1] - 1 - first - size
                    if differs == 0:
                        for index in range(size):
                            differs |= text[at(start + index)] ^ site_arena[at(first + index)]
                    if differs == 0:
                        found = site
                        break
                spot = (spot + 1) & mask
            if found < 0:
                return -1
            mentions[mentioned] = found
            mentioned += 1
            place = _blank(text, place)
            if text[place] == _CLOSE:
                more = False
                if place != end - 1:
                    return -1
            elif text[place] == _COMMA:
                place = _blank(text, place + 1)
            else:
                return -1
    texts.parts_at[4 * number + 4] = mentioned
    totals[TEXTS], totals[TEXT_BYTES], totals[MENTIONS] = number + 1, up, mentioned
    totals[SITES], totals[SITE_BYTES] = sites, site_up
    return int(number)


@compiled
def rehash(old: Totals, new: Totals) -> None:
    """Put the numbers of a hash table into an empty, larger one."""
    mask = len(new) - 1
    for place in range(len(old)):
        here = old[place]
        if here != 0:
            slot = (here >> 32) & mask
            while new[slot] != 0:
                slot = (slot + 1) & mask
            new[slot] = here
