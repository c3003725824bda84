"""Networks as rules: rows by themselves and together, and files of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cubepath.agents.local.relative import relative_layout
from cubepath.agents.rules.policy import FORMAT, Layer, PolicyNetwork, network_rule, read_network
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.stacked import Side

SPEC = "agv:graph=grid3x3,n=3"


def network(*widths: int, seed: int = 0) -> PolicyNetwork:
    """Return a network with any weights."""
    random = np.random.default_rng(seed)
    layers = [
        Layer(random.normal(size=(entering, leaving)), random.normal(size=leaving), how)
        for entering, leaving, how in zip(
            widths, widths[1:], ["relu", "tanh", "none"][4 - len(widths) :], strict=False
        )
    ]
    return PolicyNetwork("relative", tuple(layers))


def fitting(seed: int = 0) -> PolicyNetwork:
    """Return a network for vehicles on a grid."""
    system = scene_from_spec(SPEC).system
    return network(relative_layout(system).length, 8, 8, system.move_slots + 1, seed=seed)


@given(st.integers(0, 2**32), st.integers(1, 70))
def test_a_row_depends_on_no_other(seed: int, rows: int) -> None:
    """What comes of it alone is what comes of it among others, to the last bit."""
    random = np.random.default_rng(seed)
    found = network(5, 7, 6, 3, seed=seed)
    seen = random.uniform(-1, 1, (rows, 5)).astype(np.float32)
    together = found.logits(seen)
    assert together.shape == (rows, 3)
    alone = np.concatenate([found.logits(row[np.newaxis]) for row in seen])
    np.testing.assert_array_equal(together, alone)
    by_hand = seen.astype(float)
    for layer in found.layers:
        by_hand = by_hand @ layer.weight + layer.bias
        if layer.activation != "none":
            by_hand = np.tanh(by_hand) if layer.activation == "tanh" else np.maximum(by_hand, 0)
    np.testing.assert_allclose(together, by_hand, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("deterministic", [False, True])
def test_a_network_chooses_the_same_alone_and_in_batches(deterministic: bool) -> None:
    """Legal actions, each module from its own stream."""
    rule = network_rule("network", fitting(), deterministic=deterministic)
    assert Side(scene_from_spec(SPEC), rule, [1, 2, 3]).play(8)


def test_actions_are_drawn_by_their_probabilities() -> None:
    """Of many draws, evenly spread, each legal action gets its share, and no other gets any."""
    weights = Layer(np.zeros((1, 4)), np.log([1.0, 2.0, 3.0, 2.0]), "none")
    rule = network_rule("network", PolicyNetwork("absolute", (weights,)), deterministic=False)
    # What the rule asks, which takes the draws that it is given.
    held: list[Any] = [cell.cell_contents for cell in rule.make.__closure__ or ()]
    (ask,) = [each for each in held if getattr(each, "__name__", "") == "choose"]
    count = 6000
    draws = np.arange(count) / count
    masks = np.tile(np.array([1, 1, 1, 0], np.int8), (count, 1))
    chosen = ask(np.zeros((count, 1), np.int32), masks, draws)
    assert np.bincount(chosen, minlength=4).tolist() == [1000, 2000, 3000, 0]
    last = ask(np.zeros((1, 1), np.int32), masks[:1], np.array([np.nextafter(1, 0)]))
    assert last.tolist() == [2]


def test_a_network_fits_what_it_was_made_for() -> None:
    """Systems whose observations have its shape, and no others."""
    rule = network_rule("network", fitting(), deterministic=False)
    for spec, fits in ((SPEC, True), ("agv:graph=grid5x4,n=2", True), ("hex:n=3", False)):
        assert rule.fits(scene_from_spec(spec).system) == fits
    assert not rule.fits(scene_from_spec("hex-connected").system)


def write(path: Path, **changed: Any) -> None:
    """Write a file of a network of one layer, with changes."""
    arrays: dict[str, Any] = {
        "format": FORMAT,
        "observation": "absolute",
        "weight_0": np.ones((3, 2)),
        "bias_0": np.ones(2),
        "activation_0": "none",
    }
    np.savez(path, **{k: v for k, v in (arrays | changed).items() if v is not None})


def test_a_network_is_read_as_it_was_written(tmp_path: Path) -> None:
    """Its weights, its activations and what it sees."""
    path = tmp_path / "a.npz"
    write(path)
    found = read_network(path)
    assert found.observation == "absolute"
    assert found.logits(np.ones((1, 3), np.int32)).tolist() == [[4.0, 4.0]]


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"format": "other"}, "format 'other', expected 'cubepath-network-1'"),
        ({"format": None}, "format"),
        ({"observation": "odd"}, "observation='odd': expected 'absolute' or 'relative'"),
        ({"bias_0": np.ones(3)}, r"layer 0: weights (3, 2) and bias (3,) do not fit"),
        ({"bias_0": None}, "bias_0"),
        ({"activation_0": "elu"}, "layer 0: activation 'elu' is not known"),
        ({"weight_0": None}, "there is no layer"),
        ({"weight_0": np.array(["a"])}, "layer 0: "),
        ({"weight_0": np.array([[{}, 1]], dtype=object)}, "Object arrays cannot be loaded"),
    ],
)
def test_what_is_no_network_is_one_line(tmp_path: Path, changed: Any, why: str) -> None:
    """With the file and the reason."""
    path = tmp_path / "bad.npz"
    write(path, **changed)
    with pytest.raises(InputError) as error:
        read_network(path)
    (line,) = str(error.value).splitlines()
    assert line.startswith(f"{path}: ") or why in line
    assert why in line


def test_other_files_are_no_networks(tmp_path: Path) -> None:
    """Text, an array, and nothing at all."""
    for data in (b"", b"text", (np.lib.format.MAGIC_PREFIX + b"\\1\\0")):
        path = tmp_path / "bad.npz"
        path.write_bytes(data)
        with pytest.raises(InputError, match=r"bad\.npz: no network"):
            read_network(path)
    np.save(tmp_path / "array.npy", np.ones(3))
    with pytest.raises(InputError, match=r"array\.npy: no network"):
        read_network(tmp_path / "array.npy")
