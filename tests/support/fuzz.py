"""Calls everything with anything: `python -m tests.support.fuzz [examples a function]`.

A call may fail with an exception that is documented, and a message. It must not panic, hang, end the process or give
numbers that are not finite.
"""

import faulthandler
import sys
from typing import Any

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from tests.support import surface

DOCUMENTED = (ValueError, TypeError, OverflowError, ArithmeticError, RuntimeError, MemoryError, KeyError, OSError)
#: What is named is no attribute.
BY_NAME = ("call", "get_attr", "set_attr")
#: Words of a message that tell a mistake of ours.
OURS = ("internal error", "panic", "unreachable", "borrowed")
#: A call that takes longer hangs, s.
DEADLINE = 30

WRONG = st.one_of(
    st.sampled_from(surface.FLOATS),
    st.sampled_from(surface.INTEGERS),
    st.sampled_from(surface.OBJECTS).map(lambda make: make()),
    st.lists(st.sampled_from(surface.FLOATS), min_size=2, max_size=4),
    st.builds(
        surface.array,
        st.sampled_from(surface.SHAPES),
        st.sampled_from(surface.DTYPES),
        st.sampled_from(surface.FLOATS),
        st.sampled_from(["C", "F", "strided"]),
    ),
)


def keywords(draw: Any, target: surface.Target) -> dict[str, Any]:
    """Arguments, most of them right: what is behind a check is reached only if the check passes."""
    given_names = [
        name for name, needed in target.arguments if draw(st.integers(0, 19)) > 0 and (needed or draw(st.booleans()))
    ]
    wrong = set(draw(st.lists(st.sampled_from(given_names), max_size=2))) if given_names else set()
    return {
        name: draw(WRONG) if name in wrong else draw(st.sampled_from(target.right(name))) for name in given_names
    }


def check(target: surface.Target, instance: Any, arguments: dict[str, Any]) -> None:
    """Calls a target and judges what comes of it."""
    allowed = (*DOCUMENTED, AttributeError) if target.name.endswith(BY_NAME) else DOCUMENTED
    faulthandler.dump_traceback_later(DEADLINE, exit=True)
    try:
        positional = () if instance is None else (instance,)
        result = target.function(*positional, **arguments)
        found = surface.numbers_that_are_not_finite(result, "result")
        if instance is not None:
            found += surface.numbers_that_are_not_finite(instance, "self")
        # The sky has no end.
        if target.name != "Renderer.depth":
            assert not found, found
    except allowed as error:
        assert str(error), f"{type(error).__name__} without a message"
        assert not any(word in str(error).lower() for word in OURS), f"{type(error).__name__}: {error}"
    finally:
        faulthandler.cancel_dump_traceback_later()


def fuzz(target: surface.Target, examples: int) -> None:
    """Calls a target with many arguments."""

    @settings(
        max_examples=examples,
        derandomize=True,
        deadline=None,
        database=None,
        phases=[Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.data())
    def run(data: st.DataObject) -> None:
        instance = data.draw(st.sampled_from(target.instances))() if target.instances else None
        check(target, instance, keywords(data.draw, target))

    run()


def main() -> int:
    """Fuzzes all targets; the number of those that failed."""
    examples = int(sys.argv[1]) if len(sys.argv) > 1 else 25
    failed = 0
    for target in surface.targets():
        try:
            fuzz(target, examples)
        except (Exception, BaseExceptionGroup if sys.version_info >= (3, 11) else Exception) as error:
            failed += 1
            notes = "\n".join(getattr(error, "__notes__", []))
            print(f"{target.name}: {type(error).__name__}: {error}\n{notes}", flush=True)
        except BaseException as error:
            # A panic is no Exception.
            if type(error).__name__ != "PanicException":
                raise
            failed += 1
            print(f"{target.name}: panic: {error}", flush=True)
    return min(failed, 1)


if __name__ == "__main__":
    faulthandler.enable()
    sys.exit(main())
