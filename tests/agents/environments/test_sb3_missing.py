"""Without the libraries for learning, one line says what to install."""

import sys

import pytest

from cubepath.agents.environments.sb3 import sb3_env, sb3_rule
from cubepath.protocol.core.errors import InputError


def test_without_the_library_one_line_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """For environments; rules of what was learned do without it."""
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.vec_env", None)
    monkeypatch.delitem(sys.modules, "cubepath.agents.environments.sb3_vec_env", raising=False)
    with pytest.raises(InputError) as error:
        sb3_env("hex:n=3")
    assert str(error.value) == "sb3_env takes Stable-Baselines3: pip install 'cubepath[learning]'"
    with pytest.raises(InputError) as error:
        sb3_rule("learned", "a model")
    assert str(error.value).startswith("a model: No such file")
    with pytest.raises(InputError) as error:
        sb3_rule("learned", object())
    assert str(error.value) == ("object: expected a model with an MlpPolicy, such as a MaskablePPO")
