"""ONNX files whose metadata were edited: a policy that acts, or an error that states what is wrong."""

import json

import numpy as np
import pytest

onnx = pytest.importorskip("onnx", reason="policies are edited with onnx: install 'ballbot-rs[export]'")
pytest.importorskip("onnxruntime", reason="needs 'ballbot-rs[onnx]'")
pytest.importorskip("hypothesis", reason="nothing is fuzzed: install 'ballbot-rs[dev]'")

from hypothesis import given  # noqa: E402
from hypothesis import strategies as st  # noqa: E402

from ballbot_rs.control.onnx_policy import FIELDS, PREFIX, OnnxPolicy  # noqa: E402
from ballbot_rs.control.resolve import ResolvedController  # noqa: E402
from ballbot_rs.viewer.session import Session  # noqa: E402
from tests.support.fuzzing import budget, numbers, values  # noqa: E402
from tests.support.onnx_policies import SHIPPED  # noqa: E402

OPTIONS = OnnxPolicy(SHIPPED).env_options
OPTION_VALUES = st.one_of(values, numbers, st.sampled_from(["paper", "kugle", "/dev/zero", "/dev/zero.toml", "x.toml"]))

#: Some options replaced, and sometimes an unknown option.
edited_options = st.dictionaries(
    st.sampled_from([*OPTIONS, "robot", "num_threads", "more"]), OPTION_VALUES, min_size=1, max_size=3
)


def check(path):
    """Loads a policy; False if it is rejected."""
    try:
        policy = OnnxPolicy(path)
    except (ValueError, TypeError, OSError):
        return False
    action = policy.act(np.zeros(16, dtype=np.float32))
    assert action.shape == (3,)
    assert np.isfinite(action).all()
    assert isinstance(policy.env_options, dict)
    return True


def test_edited_metadata_give_a_policy_or_an_error(tmp_path):
    model, path, loaded = onnx.load(SHIPPED), tmp_path / "edited.onnx", []
    original = {entry.key: entry.value for entry in model.metadata_props}
    texts = st.one_of(
        st.text(max_size=30),
        values.map(json.dumps),
        edited_options.map(lambda changes: json.dumps({**OPTIONS, **changes})),
        st.sampled_from([*original.values(), "[" * 3000, '{"a":' * 1000, "1e999", "NaN", str(10**400)]),
    )

    @budget(250)
    @given(changes=st.dictionaries(st.sampled_from([PREFIX + field for field in FIELDS]), texts, max_size=2))
    def feed(changes):
        del model.metadata_props[:]
        onnx.helper.set_model_props(model, {**original, **changes})
        path.write_bytes(model.SerializeToString())
        loaded.append(check(path))

    feed()
    assert 10 < loaded.count(True) < len(loaded) - 10


@pytest.mark.slow("fuzzes metadata")
def test_a_session_runs_with_any_options_or_reports_why_not():
    act, ran = OnnxPolicy(SHIPPED).act, []

    @budget(300)
    @given(changes=edited_options)
    def feed(changes):
        # A file of another history is rejected for its shape.
        changes.pop("history", None)
        session = Session()
        try:
            session.choose(controller=ResolvedController("edited.onnx", {**OPTIONS, **changes}, act))
        except (ValueError, TypeError, OSError):
            assert session.controller == "lqr"
            return
        for _ in range(3):
            session.step()
        assert np.isfinite(session.frame().states).all()
        ran.append(True)

    feed()
    assert len(ran) > 10
