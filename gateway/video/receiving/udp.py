"""The UDP socket that the robot sends its pictures to (§2.6.3), with a large receive buffer, and what the kernel lost."""

from __future__ import annotations

import errno
import socket
import struct
from typing import Final

from gateway.video.errors import VideoCode, VideoError

__all__ = ["MAX_DATAGRAM_BYTES", "PORT", "RECEIVE_BUFFER_BYTES", "UdpSocket", "addresses_of"]

PORT: Final = 8890
"""The robot sends its pictures there (§5.1)."""
RECEIVE_BUFFER_BYTES: Final = 8_000_000
"""Asked for: 3 s of a stream of 20 Mbit/s."""
MAX_DATAGRAM_BYTES: Final = 65_536
_SO_RCVBUFFORCE: Final = 33  # Linux: beyond net.core.rmem_max, for whoever may administer the network
_SO_MEMINFO: Final = 55  # Linux: numbers of a socket's memory
_MEMINFO: Final = struct.Struct("9I")
_DROPS: Final = 8


class UdpSocket:
    """A bound socket; close it.

    Args:
        port: UDP port; 0 takes a free one.
        host: Local address to bind to; all of IPv4 by default.
        buffer_bytes: Receive buffer that is asked for.
        wait_s: Longest wait of `receive` [s].

    Raises:
        VideoError: PORT_BUSY or BAD_ADDRESS.
    """

    def __init__(
        self, port: int = PORT, *, host: str = "", buffer_bytes: int = RECEIVE_BUFFER_BYTES, wait_s: float = 0.02
    ) -> None:
        self._socket = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise _cannot_bind(error, host, port) from error
        self.port = int(self._socket.getsockname()[1])
        """The port that it is bound to."""
        self.granted_bytes = self._ask_for(buffer_bytes)
        """What the kernel granted as receive buffer; it reserves twice as much, for its own bookkeeping."""
        seconds = int(wait_s)
        self._socket.setsockopt(
            socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", seconds, round((wait_s - seconds) * 1e6))
        )
        self._memory = memoryview(bytearray(MAX_DATAGRAM_BYTES))

    def receive(self) -> tuple[memoryview, str] | None:
        """Return the next datagram, valid until the next call, and its sender's address; None when none came in time.

        Raises:
            OSError: If the socket is broken, or closed.
        """
        try:
            size, address = self._socket.recvfrom_into(self._memory)
        except BlockingIOError:
            return None
        return self._memory[:size], address[0]

    def dropped(self) -> int:
        """Return how many datagrams the kernel had no room for since the socket was opened; 0 where it does not tell."""
        try:
            raw = self._socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size)
            return int(_MEMINFO.unpack(raw)[_DROPS])
        except (OSError, struct.error):
            return 0

    def close(self) -> None:
        """Close it."""
        self._socket.close()

    def _ask_for(self, size: int) -> int:
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size)
        if self._granted() < size:
            try:
                self._socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, size)
            except OSError:
                pass  # not permitted to most; what was granted is reported
        return self._granted()

    def _granted(self) -> int:
        return self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2


def addresses_of(host: str) -> frozenset[str]:
    """Return all addresses of a host.

    Raises:
        VideoError: BAD_ADDRESS: there is no such host.
    """
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:
        raise VideoError(
            VideoCode.BAD_ADDRESS,
            f"the robot's address {host!r} cannot be resolved: {error}",
            "give its IP address as the system configuration shows it (§2.3)",
        ) from error
    return frozenset(str(address[0]) for *_, address in found)


def _cannot_bind(error: OSError | OverflowError, host: str, port: int) -> VideoError:
    if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
        return VideoError(
            VideoCode.PORT_BUSY,
            f"udp port {port} is taken on this host: another program receives the video",
            f"stop it (`ss -ulpn sport = :{port}` names it), or give another port here and in the robot's configuration",
        )
    return VideoError(
        VideoCode.BAD_ADDRESS,
        f"cannot listen on udp {host or '0.0.0.0'}:{port}: {error}",
        "give an address of this host, and a port from 1024 to 65535",
    )
