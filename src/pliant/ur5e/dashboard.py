"""The dashboard's `stop`: the one way to halt the arm that needs nothing of ur_rtde."""

import contextlib
import socket

PORT = 29999
_PATIENCE_S = 0.3  # for each of connecting, the greeting and the answer


def stop(address: str) -> bool:
    """End the program, which brakes the arm; whether the controller said that it has.

    ur_rtde's own calls hang when the connection is lost, `stopL` too; this does not.
    """
    with contextlib.suppress(OSError), socket.create_connection((address, PORT), _PATIENCE_S) as s:
        s.settimeout(_PATIENCE_S)
        s.sendall(b"stop\n")
        heard = b""
        while b"Stopped" not in heard:
            part = s.recv(1024)  # the greeting comes first
            if not part:
                return False
            heard += part
        return True
    return False
