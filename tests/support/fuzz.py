"""Calls everything with anything: `python -m tests.support.fuzz [examples per function]`.

A call may fail with a documented exception and a message. It must not panic, hang, end the process or return numbers
that are not finite.
"""

import faulthandler
import sys
from typing import Any

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from tests.support import surface

DOCUMENTED = (ValueError, TypeError, OverflowError, ArithmeticError, RuntimeError, MemoryError, KeyError, OSError)
#: Methods that take a name, which may not be an attribute.
BY_NAME = ("call", "get_attr", "set_attr")
#: Words in a message that indicate a bug of ours.
OURS = ("internal error", "panic", "unreachable", "borrowed")
#: A call that takes longer counts as hanging, s.
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
    """Arguments, most of them valid: code after a check is reached only if the check passes."""
    given_names = [
        name for name, needed in target.arguments if draw(st.integers(0, 99)) > 0 and (needed or draw(st.booleans()))
    ]
    wrong = (
        set(draw(st.lists(st.sampled_from(given_names), max_size=2)))
        if given_names and draw(st.integers(0, 3))
        else set()
    )
    return {name: draw(WRONG) if name in wrong else draw(st.sampled_from(target.right(name))) for name in given_names}


def complaints(target: surface.Target, instance: Any, arguments: dict[str, Any]) -> list[str]:
    """Calls a target; returns what is wrong with the result."""
    allowed = (*DOCUMENTED, AttributeError) if target.name.endswith(BY_NAME) else DOCUMENTED
    positional = () if instance is None else (instance,)
    faulthandler.dump_traceback_later(DEADLINE, exit=True)
    try:
        results = [target.function(*positional, **arguments)]
        if type(instance).__name__ in surface.THEN:
            results.append(surface.THEN[type(instance).__name__](instance))
    except allowed as error:
        message = f"{type(error).__name__}: {error}"
        wrong = not str(error) or any(word in message.lower() for word in OURS)
        return [message] if wrong else []
    finally:
        faulthandler.cancel_dump_traceback_later()
    # The sky is infinitely far, so are obstacles and other modes of a motion without any; a short episode has no
    # metrics, and values not sampled yet are NaN.
    if target.name == "Renderer.depth" or target.name.endswith((".metrics", ".draws")):
        return []
    found = [
        place
        for place in surface.numbers_that_are_not_finite(results, "results")
        if not ((".margin = " in place or target.name == "Terrain.obstacle_distance") and "nan" not in place)
    ]
    return found if instance is None else found + surface.numbers_that_are_not_finite(instance, "self")


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
        found = complaints(target, instance, keywords(data.draw, target))
        assert not found, found

    run()


def is_sound(target: surface.Target, examples: int) -> bool:
    """Fuzzes a target and prints what is wrong with it."""
    try:
        fuzz(target, examples)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        # A panic is not an Exception.
        notes = "\n".join(getattr(error, "__notes__", []))
        print(f"{target.name}: {type(error).__name__}: {error}\n{notes}", flush=True)
        return False
    return True


def main() -> int:
    """Fuzzes everything; 1 if something is wrong."""
    examples = int(sys.argv[1]) if len(sys.argv) > 1 else 25
    unsound = sum(not is_sound(target, examples) for target in surface.targets())
    return min(unsound, 1)


if __name__ == "__main__":
    faulthandler.enable()
    sys.exit(main())
