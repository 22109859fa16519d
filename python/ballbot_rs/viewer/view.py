"""Session, runner, server and page put together."""

from pathlib import Path

from ballbot_rs.viewer import shapes, urdf
from ballbot_rs.viewer.driving import Driving
from ballbot_rs.viewer.page import Page
from ballbot_rs.viewer.recording import Frame
from ballbot_rs.viewer.runner import Command, Runner
from ballbot_rs.viewer.server import HOST, LocalServer, free_port
from ballbot_rs.viewer.session import Session


class View:
    """A session on a page in the browser, running from the constructor to `stop`.

    Args:
        session: the session to show; the view owns it from now on.
        port: where the server listens; if it is taken, the next free one.
        urdfs: bot and ball of robots by name, in addition to the robots of this package.

    Raises:
        ValueError: a port out of range, or a URDF that cannot be shown.
        OSError: no port is free, or a file of a URDF cannot be read.
    """

    def __init__(self, session: Session, port: int = 8080, urdfs: dict[str, tuple[Path, Path]] | None = None) -> None:
        if not 1 <= port <= 65535:
            raise ValueError(f"port = {port} is out of range: expected 1 to 65535")
        self._urdfs = {**urdf.URDFS, **(urdfs or {})}
        self._params = {name: session.params_of(name) for name in session.robot_names}
        # Invalid files are rejected here, not by the display thread.
        self._look(session.robots.name)
        self.runner = Runner(session, self._show)
        self._driving = Driving(self._submit)
        self.server = LocalServer(free_port(port), self._driving)
        self._page = Page(self.server, self._submit, session, self._look)
        self.runner.start()

    def _submit(self, command: Command) -> bool:
        return self.runner.submit(command)

    def _show(self, session: Session, frame: Frame) -> None:
        self._driving.show(session)
        self._page.show(session, frame)

    def _look(self, name: str) -> shapes.Look:
        params = self._params[name]
        files = self._urdfs.get(name)
        if files is None or not all(path.is_file() for path in files):
            return shapes.from_params(params)
        return urdf.from_urdf(params, *files)

    @property
    def url(self) -> str:
        """The page's address."""
        return f"http://{HOST}:{self.server.get_port()}"

    def stop(self) -> None:
        """Ends the simulation and the server."""
        self.runner.stop()
        self.server.stop()
