"""Frames of the front ends."""

from collections.abc import Mapping
from typing import Any, Final

import gymnasium
import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Batch, Params, Renderer

Frames = npt.NDArray[np.uint8]

#: Gymnasium derives "human" and "rgb_array_list" from it.
RENDER_MODES: Final = ("rgb_array",)

#: Parameters that must match between a robot and the URDFs that show it.
GEOMETRY: Final = ("ball_radius", "wheel_radius", "wheel_zeniths", "wheel_azimuths")


class Rendered:
    """A render mode and a renderer, which a copy or an unpickled environment recreates at its first frame."""

    _batch: Batch
    render_mode: str | None
    _renderer: Renderer | None = None

    def _set_render(
        self,
        render_mode: str | None,
        params: Params,
        render_options: Mapping[str, Any] | None,
        num_threads: int | None = None,
        **chosen: Any,
    ) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise ValueError(f"render_mode = '{render_mode}': expected None or {', '.join(map(repr, RENDER_MODES))}")
        self.render_mode = render_mode
        given = {name: value for name, value in chosen.items() if value is not None} | dict(render_options or {})
        self._render_arguments = (params, {"num_threads": num_threads, "terrain": self._batch.terrain, **given})
        if render_mode is not None or given:
            self._renderer = self._make_renderer()

    def _make_renderer(self) -> Renderer:
        params, options = self._render_arguments
        if "urdf" not in options:
            return Renderer(params, **options)
        _check_geometry(params, Params.from_urdf(*options["urdf"]))
        return Renderer(**options)

    def _frames(self, states: npt.NDArray[Any]) -> Frames:
        """Pictures of states, shape (n, height, width, 3), each with the present parameters of its robot."""
        robots = [self._batch.params(i) for i in range(len(states))]
        if any(robot != robots[0] for robot in robots):
            pairs = zip(robots, states, strict=True)
            return np.concatenate([self._renderer_of(robot).render_batch(state[np.newaxis]) for robot, state in pairs])
        return self._renderer_of(robots[0]).render_batch(states)

    def _renderer_of(self, params: Params) -> Renderer:
        shown, options = self._render_arguments
        if self._renderer is None or params != shown:
            self._render_arguments = (params, options)
            self._renderer = self._make_renderer()
        return self._renderer


def _check_geometry(params: Params, shown: Params) -> None:
    for name in GEOMETRY:
        ours, theirs = getattr(params, name), getattr(shown, name)
        if not np.allclose(ours, theirs, rtol=1e-3):
            raise ValueError(f"the URDFs show another robot: {name} is {theirs}, but {ours} in the simulation")


def warn_without_mode() -> None:
    """The warning of `render` without a render mode."""
    gymnasium.logger.warn("render() without a render_mode shows nothing: make the environment with 'rgb_array'")
