"""Rules that see places wrongly, or may change their notes a few times: keys of every rule."""

from pathlib import Path

import pytest

from cubepath.agents.environments.rollouts import play, play_free
from cubepath.agents.environments.world import Round
from cubepath.agents.local.observation import View, observe, view_of
from cubepath.agents.locality.check import check_rule
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.limits import WrongSensing
from cubepath.agents.rules.registry import find_rule, rule_in_file
from cubepath.agents.rules.rule import RuleType
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.specs import scene_from_spec


def rule_of(name: str) -> RuleType:
    """Return the rule of a name that there is."""
    found = find_rule(name)
    assert found is not None
    return found


def view(spec: str, module: int = 0) -> View:
    """Return what a module sees at the start."""
    scene = scene_from_spec(spec)
    system, site = scene.system, scene.start[module]
    standing = {system.place_of(each): each for each in scene.start}
    seen = observe(system, site, standing, goals=frozenset())
    return view_of(system, seen, system.label_of(site))


@pytest.mark.parametrize(
    "spec", ["hex:n=5", "agv-labelled:graph=grid3x3,n=5", "words", "hex:n=5,base=1"]
)
@pytest.mark.parametrize("probability", [0.1, 0.7])
def test_places_are_wrong_with_this_probability(spec: str, probability: float) -> None:
    """To another code that they could show; the moves, and what never changes, are as they are."""
    true = view(spec, 1)
    sensing = WrongSensing(probability, key=5)
    system, first = true.system, true.system.site_size + 1
    places = [place for place in system.sensed(true.place) if place is not None]
    can = [place for place in places if system.has_place(place)]
    wrong = 0
    for _ in range(3000 // len(can)):
        seen = sensing.of(true)
        assert (seen.mask == true.mask).all()
        codes = seen.numbers[first::2].tolist()
        for place, code, before in zip(
            system.sensed(true.place), codes, true.numbers[first::2].tolist(), strict=True
        ):
            wrong += code != before
            assert code == before or place in can
            if place is not None:
                assert seen.occupied.get(place, 0) == (0 if code == 3 else code)
    assert wrong / (3000 // len(can) * len(can)) == pytest.approx(probability, abs=0.05)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_a_module_changes_its_note_so_often_and_no_more(count: int) -> None:
    """Then it repeats the last one."""
    scene = scene_from_spec("agv:graph=grid4x4,n=2,seed=1")
    rule = rule_of(f"tswap:notes={count}")
    free = rule_of("tswap")
    one, other = (actors_for(scene, each, seed=1, hesitate=0.0)[0] for each in (rule, free))
    system = scene.system
    notes, changes, last = [], 0, None
    for vertex in list(system.places)[:8]:
        seen = observe(system, vertex, {}, goals=frozenset(), note_length=one.note_length)
        notes.append(one.act(seen).note)
        note = other.act(seen).note
        changes += note != last
        last = note
    assert changes > 2
    told = [note for note in notes if note is not None]
    assert len(dict.fromkeys(told)) <= count
    assert bool(told) == (count > 0)


@pytest.mark.parametrize(
    ("spec", "name"), [("hex:n=5", "chain"), ("agv-labelled:graph=grid4x4,n=6", "pibt")]
)
def test_without_a_limit_nothing_changes(spec: str, name: str) -> None:
    """The rule draws the same numbers."""
    rounds: list[tuple[Round, ...]] = [
        play(spec, rule_of(each), seed=3).rounds for each in (name, f"{name}:misread=0,notes=999")
    ]
    assert rounds[0] == rounds[1]


@pytest.mark.parametrize("spec", ["hex:n=5", "agv-labelled:graph=grid4x4,n=6", "polygon", "arms"])
def test_what_is_seen_wrongly_ends_no_run(spec: str) -> None:
    """A rule that fails because of it makes its module stay, with rounds and without."""
    for rule in ("chain", "pibt", "crossing", "metropolis"):
        found = rule_of(f"{rule}:misread=0.4")
        if found.is_for(scene_from_spec(spec).system):
            played = play(spec, found, seed=1, max_rounds=60)
            assert played.rounds
            assert play_free(spec, found, seed=1, max_cycles=60).turns


@pytest.mark.thorough
def test_wrong_sensing_is_local() -> None:
    """It depends on the module alone."""
    assert check_rule("pibt:misread=0.1,notes=9", ["agv-labelled:graph=K5,n=3"]).findings == ()


def test_a_rule_in_a_file_has_limits_too(tmp_path: Path) -> None:
    """After its name, and one of its keys may have any value that is in bounds."""
    with pytest.raises(InputError, match="misread=1: expected at least 0 and less than 1"):
        find_rule("chain:misread=1")
    with pytest.raises(InputError, match=r"notes=1\.5: expected a whole number, 0 or more"):
        find_rule("chain:notes=1.5")
    with pytest.raises(InputError, match="notes=-1: expected 0 or more"):
        find_rule("chain:notes=-1")
    file = tmp_path / "own.py"
    file.write_text("from cubepath.agents.rules.uniform import RANDOM\nOWN = RANDOM\n")
    name = f"{file}:OWN:misread=0.5"
    assert find_rule(name) != rule_in_file(f"{file}:OWN")
    assert rule_of(name).name == "random:misread=0.5"
