"""The one thread that owns a session; all others put commands in its queue."""

import queue
import threading
import time
from collections.abc import Callable

from ballbot_rs.envs.registration import DEFAULT_TASK
from ballbot_rs.viewer.session.recording import Frame
from ballbot_rs.viewer.session.session import Session

#: Message of a deque that two threads change, in asyncio.Event.
RACE = "mutated during iteration"

Command = Callable[[Session], None]

#: Queues a command; False if the queue is full.
Submit = Callable[[Command], bool]

#: Capacity of the command queue; further commands are dropped, as from a flooding client.
MAX_COMMANDS = 256

#: Time between two frames, s.
FRAME_DT = 1.0 / 30.0

#: Most real time to catch up after a delay, s: a machine that is too slow shows slow motion, not a jam.
MAX_DELAY = 0.5

#: Simulated time between two reads of the clock, s.
SLICE = 0.05

#: How long `stop` waits, s. Calls that cannot be interrupted, such as reading a large mesh, are abandoned.
STOP_TIMEOUT = 0.1


class Runner:
    """Runs a session in real time.

    Args:
        session: nothing else may access it from now on.
        show: called with the session and the frame to show after each frame, in this thread.
    """

    def __init__(self, session: Session, show: Callable[[Session, Frame], None] | None = None) -> None:
        self._session = session
        self._show = show
        self._commands: queue.Queue[Command] = queue.Queue(MAX_COMMANDS)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ballbot-simulation", daemon=True)
        #: Simulated time, and the real time and computing time that it took without pauses, s.
        self.simulated = 0.0
        self.elapsed = 0.0
        self.computing = 0.0
        self.error: BaseException | None = None

    def start(self) -> None:
        """Begins."""
        self._thread.start()

    def stop(self) -> None:
        """Ends; a running call of a policy is interrupted."""
        self._stop.set()
        self._session.watchdog.cancel()
        self._thread.join(STOP_TIMEOUT)

    @property
    def running(self) -> bool:
        """Whether the thread exists."""
        return self._thread.is_alive()

    def submit(self, command: Command) -> bool:
        """Queues a command for the thread; False if the queue is full. From any thread."""
        try:
            self._commands.put_nowait(command)
        except queue.Full:
            return False
        return True

    def _run(self) -> None:
        try:
            last = time.perf_counter()
            while not self._stop.is_set():
                now = time.perf_counter()
                self._frame(now - last)
                last = now
                self._stop.wait(max(0.0, FRAME_DT - (time.perf_counter() - now)))
        except BaseException as error:
            self.error = error
            raise

    def _frame(self, elapsed: float) -> None:
        session = self._session
        self._carry_out_commands()
        began = time.perf_counter()
        simulated = 0.0
        try:
            simulated = self._advance(min(elapsed, MAX_DELAY))
        except Exception as error:
            if self._stop.is_set():
                return
            # A policy may return nonsense, hang or fail in any way: then the robots continue unpowered.
            session.choose(controller="zero")
            session.notices.append(f"{error or type(error).__name__}; the motors are off")
        if not session.paused and session.replay_time is None:
            self.computing += time.perf_counter() - began
            self.simulated += simulated / session.speed
            self.elapsed += elapsed
        if self._show is not None and not self._stop.is_set():
            try:
                self._show(session, session.frame())
            except RuntimeError as error:
                # viser wakes its senders from this thread, maybe while its own does. The next frame shows the rest.
                if RACE not in str(error):
                    raise

    def _advance(self, seconds: float) -> float:
        """Advances real time in slices, as many as time allows: a fast-forward may exceed the machine."""
        session, simulated = self._session, 0.0
        ends = time.perf_counter() + MAX_DELAY
        piece = SLICE / max(1.0, session.speed)
        while seconds > 0.0 and time.perf_counter() < ends:
            simulated += session.advance(min(seconds, piece))
            seconds -= piece
        return simulated

    def _carry_out_commands(self) -> None:
        for _ in range(MAX_COMMANDS):
            try:
                command = self._commands.get_nowait()
            except queue.Empty:
                return
            try:
                command(self._session)
            except Exception as error:  # Whatever a page requests, the robots continue.
                self._session.notices.append(str(error) or type(error).__name__)

    def report(self) -> str:
        """Speed so far: the real-time factor, and the factor that the simulation itself could reach."""
        session = self._session
        factor = self.simulated / self.elapsed if self.elapsed > 0.0 else 0.0
        alone = self.simulated / self.computing if self.computing > 0.0 else 0.0
        many = len(session.robots)
        what = (
            f"{many} robot{'s' if many > 1 else ''} {session.robots.name}, {session.robots.model}, {session.controller}"
        )
        if session.task != DEFAULT_TASK:
            what = f"{session.task}, {what}"
        return f"real-time factor {factor:.2f} ({what}); the simulation alone: {alone:.1f}"
