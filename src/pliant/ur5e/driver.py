"""The trial's end of the driver: it asks, it waits no longer than it must, and it stops the arm by
itself when the driver does not answer."""

import atexit
import multiprocessing
import time
from collections.abc import Callable
from typing import Any, TypeVar

from pliant import signals
from pliant.errors import InputError, RobotFault
from pliant.ur5e import dashboard
from pliant.ur5e import messages as m
from pliant.ur5e.configuration import Configuration
from pliant.ur5e.driver_process import ArmDriver, serve

_ENDING_S = 1.0
T = TypeVar("T")
Request = Callable[[ArmDriver], T]
"""A call of one of the driver's methods; a function or a `partial` of one, which can be sent."""


class Driver:
    """A driver's process. After a fault it is over: every later call raises the same fault."""

    def __init__(self, configuration: Configuration) -> None:
        self._address = configuration.arm.address
        self._silence_s = configuration.patience.driver_ms * 1e-3
        self._connect_s = configuration.patience.connect_ms * 1e-3
        self._dashboard_s = configuration.patience.dashboard_ms * 1e-3
        context = multiprocessing.get_context("spawn")  # ur_rtde's threads do not survive a fork
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs, configuration), daemon=True)
        self._process.start()
        theirs.close()
        self.fault: RobotFault | None = None
        # It ignores the signal by which Python would end it, and would be waited for without end.
        atexit.register(self.close)

    @property
    def is_usable(self) -> bool:
        return self.fault is None and self._process.is_alive()

    def connect(self) -> None:
        """Reach the controller and the gripper.

        Raises:
            RobotFault: they cannot be used.
            InputError: the extra is not installed, or there is no emulated cell.
        """
        self._ask(ArmDriver.connect, self._connect_s)

    def ask(self, request: Request[T]) -> T:
        """Have a request done, and return its result.

        Raises:
            RobotFault: the arm or its driver cannot go on; or "interrupted", by Ctrl-C or its like.
        """
        return self._ask(request, self._silence_s)

    def halt(self) -> None:
        """Brake, by the driver or, if it does not answer, without it. Raises nothing."""
        if self.fault is not None:
            return
        try:
            self.ask(ArmDriver.halt)
        except RobotFault:
            return  # kept, and whoever asks next is told

    def close(self) -> None:
        """Say goodbye and end the process."""
        if self.is_usable:
            try:
                self._pipe.send(m.Word.CLOSE)
            except OSError:
                self.fault = RobotFault("driver", "the arm's driver has ended")
        self._process.join(_ENDING_S)
        self._end()

    # --- inside ----------------------------------------------------------------------------------

    def _ask(self, request: Request[T], silence_s: float) -> T:
        if self.fault is not None:
            raise self.fault
        try:
            self._hear_fault(0.0)
            self._pipe.send(request)
            return self._answer(silence_s)
        except (EOFError, OSError) as error:
            self._process.join(_ENDING_S)
            raise self._lost(f"ended (exit status {self._process.exitcode})") from error
        except KeyboardInterrupt as error:
            raise self._interrupted() from error

    def _answer(self, silence_s: float) -> Any:
        while True:
            if not self._pipe.poll(silence_s):
                raise self._lost(f"has given no sign of life for {silence_s:.1f} s")
            match self._pipe.recv():
                case m.Done(result=result):
                    return result
                case m.Failed(kind=kind, message=message):
                    raise self._failed(kind, message)

    def _hear_fault(self, wait_s: float) -> None:
        """Raise the fault that the driver found while nobody asked it for anything."""
        while self._pipe.poll(wait_s):
            said = self._pipe.recv()
            if isinstance(said, m.Failed):
                raise self._failed(said.kind, said.message)

    def _failed(self, kind: str, message: str) -> Exception:
        if not kind:
            self.fault = RobotFault("driver", message)
            return InputError(message)
        self.fault = RobotFault(kind, message)
        return self.fault

    def _lost(self, how: str) -> RobotFault:
        """Halt the arm and end a driver that crashed, or hangs in a call that ur_rtde does not
        return from. The fault says whether the arm is halted."""
        stopped = dashboard.stop(self._address, self._dashboard_s)
        self._end()
        after = "the arm is halted" if stopped else "the controller does not confirm a halt"
        self.fault = RobotFault("driver", f"the arm's driver {how}; {after}")
        return self.fault

    def _interrupted(self) -> RobotFault:
        try:
            self._pipe.send(m.Interrupt(why=signals.cause()))
            give_up = time.monotonic() + self._silence_s
            while time.monotonic() < give_up:
                self._hear_fault(0.01)
        except RobotFault:
            pass  # as it should be
        except (EOFError, OSError):
            dashboard.stop(self._address, self._dashboard_s)
        else:
            dashboard.stop(self._address, self._dashboard_s)
        self._end()
        self.fault = signals.interrupted()
        return self.fault

    def _end(self) -> None:
        atexit.unregister(self.close)
        if self._process.is_alive():
            self._process.kill()  # SIGTERM would run destructors that hang
            self._process.join(_ENDING_S)
        self._pipe.close()
