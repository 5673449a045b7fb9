"""The dashboard's `stop`: the one way to halt the arm that needs nothing of ur_rtde."""

import contextlib
import socket

from pliant.ur5e.protocol import DASHBOARD_PORT, STOPPED


def stop(address: str, patience_s: float) -> bool:
    """End the program, which brakes the arm, and return whether the controller said that it has.
    Connecting and each answer may take `patience_s`.

    ur_rtde's own calls hang when the connection is lost, `stopL` too; this does not.
    """
    with (
        contextlib.suppress(OSError),
        socket.create_connection((address, DASHBOARD_PORT), patience_s) as s,
    ):
        s.settimeout(patience_s)
        s.sendall(b"stop\n")
        heard = b""
        while STOPPED.encode() not in heard:
            part = s.recv(1024)  # the greeting comes first
            if not part:
                return False
            heard += part
        return True
    return False
